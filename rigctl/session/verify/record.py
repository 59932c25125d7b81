"""Check that a session is the one recorded: its digests, and the files beside its parts."""

from __future__ import annotations

from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format.digests_file import DigestLines, read_digest_lines
from rigctl.session.format.file_names import part_number
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.read.closing_digest import count_committed, last_digest
from rigctl.session.read.recovery_file import read_recoveries
from rigctl.session.read.session_reader import SessionReader
from rigctl.session.verify.digest_lines import CommittedTrials, check_digest_lines, check_texts
from rigctl.session.verify.digests import (
    check_part_digests,
    check_succession,
    follower_digests,
)
from rigctl.session.verify.ending import LATER_PART_MISSING, describe_end
from rigctl.session.verify.report import OnShare, VerifyReport


class RecordCheck:
    """The check of a session's digests; parts are checked one by one, then what joins them."""

    def __init__(self, session: SessionReader, report: VerifyReport) -> None:
        self._session = session
        self._report = report
        self._lines = _lines(session, report)
        self._followers = follower_digests(session.parts, self._lines.closed)
        recoveries = read_recoveries(session.path)
        self._recovered = {part.number: part.last_digest for r in recoveries for part in r.parts}
        report.notes += [
            f"digests.txt: was written anew from the parts, as {recovery.path.name} says"
            for recovery in recoveries
            if recovery.report.get("digest_lines")
        ]
        self._known = [rows for recovery in recoveries for rows in recovery.damaged_rows]

    def check_part(self, index: int, on_share: OnShare) -> bool:
        """Check the rows of one part; ``on_share`` takes the share of it that is done.

        Return whether there is damage, and recovery files list all of it.

        A growing part is left out: its tables were opened one after the other while it grew.
        """
        part = self._session.parts[index]
        if not part.has_digests or part.is_growing:
            return False
        size, done = max(1, part.path.stat().st_size), 0

        def add(n: int) -> None:
            nonlocal done
            done += n
            on_share(min(1.0, done / size))

        known = [rows for rows in self._known if rows.part == part.number]
        return check_part_digests(part, self._followers[part.number], known, self._report, add)

    def check_whole(self) -> None:
        """Check how parts follow each other and how the session ended."""
        session, report = self._session, self._report
        last, written = session.parts[-1], is_being_written(session.path)
        damaged = {rows.part for rows in self._known}
        check_succession(session.parts, self._recovered, damaged, report)
        try:
            if not written:
                changed = damaged | set(self._recovered)
                untouched = [part for part in session.parts if part.number not in changed]
                committed = self._committed(whole=not changed)
                check_digest_lines(self._lines, untouched, committed, report)
            check_texts(session.path, session.parts[0], report)
            report.outcome = describe_end(last, written)
        except SessionError as error:
            report.problems.append(str(error))
        if any(part_number(Path(part.name)) > last.number for part in session.missing_parts):
            report.outcome = LATER_PART_MISSING
        if session.finished and last.has_digests and not written:
            report.closing_digest = last_digest(last)

    def _committed(self, whole: bool) -> CommittedTrials:
        parts = self._session.parts
        whole = whole and not self._session.missing_parts
        return CommittedTrials(count_committed(parts), whole)


def _lines(session: SessionReader, report: VerifyReport) -> DigestLines:
    try:
        return read_digest_lines(session.path)
    except SessionError as error:
        report.problems.append(str(error))
        return DigestLines()
