"""Write a session's parts: the recorder's actions on the files, and the state of the disk.

Everything here runs in the recorder's thread, the only one that uses HDF5 while it writes a
session.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Protocol

from rigctl.errors import DiskFault
from rigctl.session.format import file_names, layout
from rigctl.session.format.data_sets import SessionLayout, TableLayout
from rigctl.session.format.digests_file import CONTINUES, DigestLine, append_line, utc_at
from rigctl.session.format.layout import SessionOutcome
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.format.table_rows import Row, event_row
from rigctl.session.hdf5_file import Attributes, system_error
from rigctl.session.write.part_writer import PartWriter, SampleBlock
from rigctl.session.write.session_history import SessionHistory
from rigctl.values import Event, Gap, Verdict

_REMEDIES = {
    errno.ENOSPC: "the disk is full: make room, then resume the session",
    errno.EDQUOT: "your disk quota is used up: make room, then resume the session",
    errno.EROFS: "the disk is read-only: check or replace it, then resume the session",
    errno.EACCES: "the folder is not writable: check its permissions, then resume the session",
    errno.EFBIG: "the file may not grow further (file size limit): lift it, then resume",
    errno.EIO: "the disk reports an error: check or replace it, then resume the session",
}


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """Snapshot of a recorder's queue and files; counts are over its own parts.

    ``samples_on_disk``: flushed, so another process can read them.
    ``failure``: one sentence with the remedy if the recorder stopped or lost samples.
    """

    part: int
    samples_on_disk: int
    bytes_on_disk: int
    disk_free_bytes: int
    queue_samples: int = 0
    failure: str | None = None


class Attempt(Protocol):
    """What the writer reads of a finished attempt at a trial."""

    @property
    def first_counter(self) -> int:
        """Counter of its first sample, -1 without one."""

    @property
    def ended_s(self) -> float:
        """Loop time at which it ended."""


EncodeTrial = Callable[[int, int], Row]
"""Returns the row of an attempt, from its part and the row of its first sample."""


class SessionWriter:
    """Writer of a session's parts. Each flush replaces ``status`` as a whole.

    ``closing_digest`` is the last digest of the session, empty until :meth:`end_session`.
    """

    def __init__(
        self,
        folder: Path,
        session_layout: SessionLayout,
        header: SessionHeader,
        texts: tuple[str, str],
        history: SessionHistory,
    ) -> None:
        self._folder = folder
        self._layout = session_layout
        self._header = header
        self._texts = texts
        self._number = history.last_part
        self._last_digest = history.last_digest
        self._committed = set(history.committed)
        columns = [column.name for column in session_layout.trials.columns]
        self._id_column, self._verdict_column = map(columns.index, ("trial_id", "verdict"))
        self._part: PartWriter | None = None
        self._texture = ""
        self._last_at_s = header.start_loop_s
        self._closed_samples = self._closed_bytes = 0
        self._sync_due = False
        self.closing_digest = ""
        self.status = self._read_status()

    def begin_part(self, reason: str, texture: str, header: SessionHeader | None = None) -> None:
        """Close the open part and create the next, with another ``header`` if one is given."""
        self.close_part()
        self._header = header or self._header
        self._number += 1
        self._texture = texture
        attributes: Attributes = {
            "layout": layout.LAYOUT,
            "layout_version": layout.LAYOUT_VERSION,
            "part": self._number,
            "reason": reason,
            "texture": texture,
            **self._header.to_attributes(),
        }
        path = self._folder / file_names.part_name(self._number)
        self._part = PartWriter(
            path,
            self._layout,
            attributes,
            self._header.n_taxels,
            self._texts,
            self._last_digest,
        )
        self._append_line(path.name)
        self.flush()

    def add_block(self, block: SampleBlock) -> None:
        """Add samples; a lower counter means that the board restarted and begins a new part."""
        part = self._open_part(block.arrived_s)
        expected = part.counters.next_counter
        if len(block) and expected is not None and block.counters[0] < expected:
            self.begin_part(f"the {self._layout.board} restarted", self._texture)
            part = self._open_part()
        part.add_block(block)

    def add_gap(self, gap: Gap) -> None:
        """Add a gap of samples that the recorder itself dropped."""
        self._open_part().add_gap(gap)

    def add_rows(self, table: TableLayout, at_s: float, rows: Sequence[Row]) -> None:
        """Add rows of a table, of loop time ``at_s``."""
        self._open_part(at_s).add_rows(table, rows)

    def add_event(self, event: Event) -> None:
        """Add an event."""
        self.add_rows(layout.EVENTS, event.at_s, [event_row(event)])

    def commit_trial(self, row: Attempt, encode: EncodeTrial) -> None:
        """Add an attempt's row, as ``encode`` returns it; an fsync follows the next flush."""
        part = self._open_part(row.ended_s)
        first_sample = part.counters.row_of(row.first_counter)
        stored = encode(self._number, first_sample)
        part.add_rows(self._layout.trials, [stored])
        if stored[self._verdict_column] == Verdict.COMMITTED.value.encode():
            self._committed.add(stored[self._id_column])
        self._sync_due = True

    def sync(self) -> None:
        """Write all added rows and sync them to the medium (fsync)."""
        self._sync_due = True
        self.flush()

    def flush(self) -> None:
        """Write all added rows to the file and update ``status``."""
        if self._part is not None:
            self._part.write()
            if self._sync_due:
                self._part.sync()
        self._sync_due = False
        self.status = self._read_status()

    def end_session(self, outcome: SessionOutcome | None) -> None:
        """Close the open part as the last one of this sitting.

        Without an ``outcome``, the session is finished if every planned trial is committed.
        """
        if self._part is None:
            return
        if outcome is None:
            complete = len(self._committed) >= self._header.trials_planned
            outcome = SessionOutcome.FINISHED if complete else SessionOutcome.STOPPED
        counts = {"committed": len(self._committed), "planned": self._header.trials_planned}
        data = {"outcome": outcome.value, **counts}
        text = f"The session is {outcome}." if outcome != "failed" else "The session failed."
        self.add_event(Event(self._last_at_s, layout.SESSION_END_KIND, text, data))
        self.close_part(outcome)
        self.closing_digest = self._last_digest

    def close_part(self, word: str = CONTINUES) -> None:
        """Close the open part with an event as its last row; nothing writes to it again.

        ``word`` says in ``digests.txt`` why: another part follows, or how the session ended.
        """
        if self._part is None:
            return
        self.add_event(
            Event(self._last_at_s, layout.PART_END_KIND, "The part was closed in order.")
        )
        self.sync()
        part, self._part = self._part, None
        self._last_digest = part.last_digest
        part.close()
        self._closed_samples += part.samples_written
        self._closed_bytes += part.path.stat().st_size
        self._append_line(part.path.name, word)
        self.status = self._read_status()

    def abandon(self) -> None:
        """Close the file after a failure; flushed rows stay readable."""
        part, self._part = self._part, None
        # The failure that the caller reports may keep HDF5 from writing its last bytes too.
        with suppress(OSError, RuntimeError):
            if part is not None:
                part.abandon()

    def _open_part(self, at_s: float = -inf) -> PartWriter:
        """Return the open part, for data of loop time ``at_s``."""
        if self._part is None:
            raise DiskFault("begin a part before recording data")
        self._last_at_s = max(self._last_at_s, at_s)
        return self._part

    def _append_line(self, name: str, word: str = "") -> None:
        """Append the line of a part that is opened, or closed for the reason that ``word`` says."""
        counts = f"{len(self._committed)}/{self._header.trials_planned}" if word else ""
        utc = utc_at(self._header, self._last_at_s)
        append_line(self._folder, DigestLine(utc, name, word, counts, self._last_digest))

    def _read_status(self) -> RecorderStatus:
        part = self._part
        return RecorderStatus(
            part=self._number,
            samples_on_disk=self._closed_samples + (part.samples_written if part else 0),
            bytes_on_disk=self._closed_bytes + (part.size_bytes() if part else 0),
            disk_free_bytes=shutil.disk_usage(self._folder).free,
        )


def failure_message(error: BaseException, folder: Path) -> str:
    """Return a sentence with the remedy for the error that stopped the writer."""
    if isinstance(error, DiskFault):
        return f"Recording into {folder} stopped: {error}."
    code = system_error(error)
    if code in _REMEDIES:
        return f"Recording into {folder} stopped, {_REMEDIES[code]}."
    detail = os.strerror(code) if code else f"{type(error).__name__}: {error}"
    return f"Recording into {folder} stopped: {detail}. Committed trials are safe."
