"""The answer of a check of a session in words."""

from __future__ import annotations

from pathlib import Path

from rigctl.session.verify.report import VerifyReport


def finding_lines(report: VerifyReport) -> list[str]:
    """Return a line for each finding."""
    notes = [f"note: {line}" for line in report.notes]
    return notes + [f"problem: {line}" for line in report.problems]


def answer(report: VerifyReport, path: Path) -> str:
    """Return whether the session is whole, what it holds, and how it ended."""
    n = len(report.problems)
    verdict = f"not whole, {n} problem{'s' * (n > 1)}" if n else "whole"
    ending = f", {report.outcome}" if report.outcome else ""
    return f"{path} is {verdict}: {contents(report)}{ending}"


def contents(report: VerifyReport) -> str:
    """Return the numbers of trials and samples in words."""
    return (
        f"{report.trials_committed:,} trials committed, {report.samples:,} samples, "
        f"{report.lost_samples:,} lost"
    )
