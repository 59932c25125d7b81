"""``rigctl verify SESSION``: is a session whole? Exit code 0 yes, 1 no, 2 not a session."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rigctl.session.verify.session import VerifyReport, verify

WHOLE, NOT_WHOLE = 0, 1
QUIET_S = 2.0


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser("verify", help="prove a session whole, or say what is wrong")
    parser.add_argument("session", type=Path, help="a session's folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print one line a finding, then the answer."""
    report = verify(args.session, _Progress())
    if args.json:
        print(json.dumps({"whole": report.whole, **asdict(report)}, ensure_ascii=False))
    else:
        _print(report, args.session)
    return WHOLE if report.whole else NOT_WHOLE


class _Progress:
    """Says on the terminal how far a long check is and how long the rest takes."""

    def __init__(self) -> None:
        self._started_s = self._told_s = time.monotonic()

    def __call__(self, share: float, what: str) -> None:
        now_s = time.monotonic()
        if now_s - self._told_s < QUIET_S or not share:
            return
        self._told_s = now_s
        left_s = (now_s - self._started_s) / share * (1.0 - share)
        print(f"{what}, about {left_s:.0f} s left", file=sys.stderr)


def _print(report: VerifyReport, path: Path) -> None:
    for line in report.notes:
        print(f"note: {line}")
    for line in report.problems:
        print(f"problem: {line}")
    held = (
        f"{report.trials_committed:,} trials committed, {report.samples:,} samples, "
        f"{report.lost_samples:,} lost"
    )
    if report.whole:
        print(f"{path} is whole: {held}")
    else:
        print(f"{path} is not whole, {len(report.problems)} problems: {held}")
