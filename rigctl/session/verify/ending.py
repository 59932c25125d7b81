"""Find out how a session ended, and compare its closing digest with one that was kept."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rigctl.errors import WrongUse
from rigctl.session.format.file_names import part_name
from rigctl.session.read.closing_digest import last_digest, session_end
from rigctl.session.read.part import PartReader
from rigctl.session.read.recovery_file import RecoveryRecord
from rigctl.session.verify.report import VerifyReport

WRITTEN, CUT_SHORT, UNKNOWN = "being written", "cut short", "closed"
LATER_PART_MISSING = "continued in a part that is missing"
_DIGEST = re.compile(r"[0-9a-f]{64}")


def parse_digest(text: str) -> str:
    """Return a closing digest as typed or pasted. Raises WrongUse for anything else."""
    digest = text.strip().lower()
    if not _DIGEST.fullmatch(digest):
        raise WrongUse(
            f"{text[:80]!r} is not a digest: give the 64 hexadecimal digits that were "
            "printed when the session was closed"
        )
    return digest


def describe_end(last: PartReader, written: bool) -> str:
    """Return how a session ended, by its last part: finished, stopped, failed or another word.

    Raises SessionError for an event that no recording wrote.
    """
    if written:
        return WRITTEN
    if not last.finished:
        return CUT_SHORT
    if not last.has_digests:
        return UNKNOWN
    end = session_end(last)
    return LATER_PART_MISSING if end is None else str(end["outcome"])


def compare_digest(
    parts: Sequence[PartReader],
    digest: str,
    recoveries: Sequence[RecoveryRecord],
    report: VerifyReport,
) -> None:
    """Compare a digest that was kept with those at the ends of the parts.

    What ``recoveries`` attest explains a break of the chain to its owner, but proves nothing:
    anyone can write such a file.
    """
    changed = {part.name for each in recoveries for part in each.parts}
    changed |= {part_name(rows.part) for each in recoveries for rows in each.damaged_rows}
    if changed:
        report.problems.append(
            f"the digest given does not prove {', '.join(sorted(changed))}: recovery files say "
            "what is missing or altered there"
        )
    ends = {last_digest(part): part for part in parts if part.has_digests}
    part = ends.get(digest)
    if part is None:
        report.problems.append(
            f"the closing digest is {report.closing_digest or 'missing'}, not {digest}: this is "
            "not the session as it was when that digest was printed"
        )
    elif part is not parts[-1]:
        report.notes.append(
            f"the digest given is that of {part.path.name}: the session is proved up to there, "
            f"not the parts after it, which have the digest {report.closing_digest or 'of none'}"
        )
    elif not report.closing_digest:
        report.notes.append("the digest given is that of the last block of rows")
    elif report.whole:
        report.notes.append("the closing digest is the one given: nothing was altered since")
