"""What a part of a campaign has to say."""

from __future__ import annotations

import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.guard import Finding


class Outcome(NamedTuple):
    """A report in lines, and whether something was found."""

    report: str
    found: bool


def folder_name(failure: str, where: str) -> str:
    """Return a name for the folder of a cause."""
    words = re.sub(r"[^a-z0-9]+", "-", f"{failure} {where}".lower())
    return f"{words[:80].strip('-')}-{hashlib.sha256(where.encode()).hexdigest()[:6]}"


def keep_findings(first_line: str, findings: Sequence[Finding], results: Path) -> Outcome:
    """Keep the first finding of each cause as a text, and count all."""
    counts = Counter((finding.failure, finding.where) for finding in findings)
    firsts = {(finding.failure, finding.where): finding for finding in reversed(findings)}
    lines = [first_line]
    for (failure, where), count in counts.most_common():
        folder = results / folder_name(failure, where)
        folder.mkdir(parents=True, exist_ok=True)
        text = firsts[failure, where].details
        (folder / "report.txt").write_text(text, encoding="utf-8", errors="backslashreplace")
        lines.append(f"{failure}: {count} × {where}: {folder}")
    return Outcome("\n".join(lines), bool(findings))
