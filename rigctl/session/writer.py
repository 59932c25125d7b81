"""Write a session's parts: append rows, flush and sync them, never rewrite any.

Everything here runs in the recorder's thread, the only one that uses HDF5 while it writes a
session.
"""

from __future__ import annotations

import errno
import os
import shutil
from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import DiskFault
from rigctl.session import layout
from rigctl.session.digests import (
    FIRST_DIGEST,
    DigestChain,
    describe_empty_part,
    describe_part,
)
from rigctl.session.hdf5_file import Attributes, system_error
from rigctl.session.header import SessionHeader
from rigctl.session.layout import (
    ARRIVALS,
    DIGESTS,
    GAPS,
    LIBVER,
    Row,
    SessionLayout,
    SessionOutcome,
    TableLayout,
    build_part,
    empty_part,
    event_row,
)
from rigctl.session.part import PREVIOUS_DIGEST
from rigctl.session.writer_lock import sync_folder
from rigctl.values import Event, Gap, Verdict

CHUNK_CACHE_BYTES = 1 << 20
"""For each data set: rows are appended and never read again, so the default of HDF5 2.0, 8 MiB,
would only fill up for the first hour of a recording."""

COPY_BYTES = 1 << 24
FLUSHES_A_DIGEST = 4
"""A digest for each flush would fill a quarter of the file."""


class SampleBlock(Protocol):
    """Samples that arrived together, with an attribute for each array of the layout."""

    @property
    def counters(self) -> NDArray[np.int64]:
        """The board's own sample number, int64 (n,), ascending."""

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Losses found directly before or inside the block."""

    @property
    def arrived_s(self) -> float:
        """Loop time at which the bytes arrived."""

    def __len__(self) -> int: ...


class CounterMap:
    """Map from board counters to rows of a part: one entry for each run without a gap."""

    def __init__(self) -> None:
        self._counters: list[int] = []
        self._rows: list[int] = []
        self.next_row = 0
        self.next_counter: int | None = None

    def add(self, block: SampleBlock) -> None:
        """Add the rows of ``block``; its counters must ascend."""
        counters = block.counters
        end = int(counters[-1]) + 1
        if counters[0] == self.next_counter and end - counters[0] == len(block):
            self.next_row, self.next_counter = self.next_row + len(block), end
            return
        before = counters[0] - 2 if self.next_counter is None else self.next_counter - 1
        starts = np.flatnonzero(np.diff(counters, prepend=before) != 1)
        self._counters += counters[starts].tolist()
        self._rows += (self.next_row + starts).tolist()
        self.next_row += len(block)
        self.next_counter = end

    def row_of(self, counter: int) -> int:
        """Return the row of the first sample with at least this counter; -1 if none has."""
        if counter < 0 or self.next_counter is None or counter >= self.next_counter:
            return -1
        run = bisect_right(self._counters, counter) - 1
        if run < 0:
            return 0
        row = self._rows[run] + counter - self._counters[run]
        run_end = self._rows[run + 1] if run + 1 < len(self._rows) else self.next_row
        return min(row, run_end)


class PartWriter:
    """Writer of an open part. Call all methods in the writer's thread; they may raise OSError.

    ``add_*`` buffer rows and :meth:`write` appends them to the file, with their digests if the
    layout has some. ``own``: attributes besides those that all parts of a session have.
    ``previous_digest`` is the last digest of the session's part before this one.
    """

    def __init__(
        self,
        path: Path,
        layout: SessionLayout,
        attributes: Attributes,
        n_taxels: int,
        texts: tuple[str, str],
        previous_digest: str = FIRST_DIGEST,
        own: Attributes | None = None,
    ) -> None:
        self.path = path
        self._layout = layout
        own = own or {}
        if layout.has_digests:
            own = {**own, PREVIOUS_DIGEST: previous_digest}
        self.counters = CounterMap()
        self.samples_written = 0
        self._blocks: list[SampleBlock] = []
        self._rows: dict[str, list[Row]] = {table.path: [] for table in layout.tables}
        self._uncovered: dict[str, list[NDArray[Any]]] = {}
        empty = empty_part(layout, n_taxels, texts, tuple(attributes.items()))
        _write_new(path, build_part(empty, own))
        self._file = h5py.File(
            _temporary_path(path), "r+", libver=LIBVER, rdcc_nbytes=CHUNK_CACHE_BYTES
        )
        paths = [each.path for each in layout.arrays]
        paths += [each.path for each in layout.stored_tables]
        self._datasets = {path: self._file[path] for path in paths}
        self._row_types = {path: dataset.dtype for path, dataset in self._datasets.items()}
        try:
            described = b""
            if layout.has_digests:
                described = describe_part(self._file, describe_empty_part(empty), [*own])
            self._digests = DigestChain(previous_digest, described)
            self._start()
        except BaseException:
            self.abandon()
            raise

    def _start(self) -> None:
        """Switch to SWMR mode: readers may open the file from now on, so it gets its name."""
        self._file.swmr_mode = True
        os.fsync(self._file.id.get_vfd_handle())
        if _RENAMES_OPEN_FILES:
            layout.begun_path(self.path).rename(self.path)
        sync_folder(self.path.parent)

    def add_block(self, block: SampleBlock) -> None:
        """Buffer samples, their arrival and the gaps found with them."""
        if len(block):
            self.add_rows(ARRIVALS, [(self.counters.next_row, block.arrived_s)])
            self.add_samples(block)
        for gap in block.gaps:
            self.add_gap(gap)

    def add_samples(self, block: SampleBlock) -> None:
        """Buffer samples alone, of a layout without arrivals and gaps."""
        self.counters.add(block)
        self._blocks.append(block)

    def add_gap(self, gap: Gap) -> None:
        """Buffer one gap; its row is that of the first sample after it."""
        row = self.counters.row_of(gap.first_counter)
        row = row if row >= 0 else self.counters.next_row
        reason = gap.reason.encode()[:32].decode(errors="ignore").encode()
        self.add_rows(GAPS, [(gap.first_counter, gap.count, row, reason)])

    def add_rows(self, table: TableLayout, rows: Sequence[Row]) -> None:
        """Buffer rows of one table."""
        self._rows[table.path].extend(rows)

    @property
    def last_digest(self) -> str:
        """The digest of everything that :meth:`write` wrote."""
        return self._digests.last

    def write(self, covers: bool = True) -> None:
        """Append all buffered rows and flush them: samples, then tables, trials, digests.

        Unless it ``covers`` them by digests, a later call does.
        """
        touched = self._write_samples()
        order = sorted(self._rows, key=lambda path: path == self._layout.trials.path)
        for path in order:
            rows, self._rows[path] = self._rows[path], []
            if rows:
                touched.append(self._append_rows(path, np.array(rows, self._row_types[path])))
        if digests := self._cover() if covers else []:
            blocks = np.array(digests, self._row_types[DIGESTS.path])
            touched.append(_append(self._datasets[DIGESTS.path], blocks))
        for dataset in touched:
            dataset.id.flush()
        self.samples_written = self.counters.next_row

    def sync(self) -> None:
        """Sync the written data to the medium (fsync).

        Raises DiskFault if the file's path does not lead to the file any more: a file without a
        name is gone when it is closed.
        """
        descriptor = self._file.id.get_vfd_handle()
        os.fsync(descriptor)
        if not _leads_to(self.path, descriptor):
            raise DiskFault(
                f"{self.path} was removed, renamed or replaced while it was recorded; "
                f"{_save_again(self.path, descriptor)}: find out who touches that folder, then "
                "resume the session"
            )

    def size_bytes(self) -> int:
        """Return the file's present size."""
        return os.fstat(self._file.id.get_vfd_handle()).st_size

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def abandon(self) -> None:
        """Close the file as its last complete flush left it, after a write failed.

        HDF5 keeps what it could not write and tries again when its objects close, which ends in
        a segmentation fault. So its descriptor first becomes one of the null device.
        """
        if os.name == "posix":
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, self._file.id.get_vfd_handle())
            os.close(null)
        self._file.close()

    def _write_samples(self) -> list[Any]:
        blocks, self._blocks = self._blocks, []
        if not blocks:
            return []
        for array in self._layout.arrays:
            rows = np.concatenate([getattr(block, array.field) for block in blocks])
            self._append_rows(array.path, rows.astype(self._row_types[array.path], copy=False))
        return [self._datasets[array.path] for array in self._layout.arrays]

    def _append_rows(self, path: str, rows: NDArray[Any]) -> Any:
        """Append rows of the data set's own type and add their digest; return the data set."""
        if self._layout.has_digests:
            self._uncovered.setdefault(path, []).append(rows)
        return _append(self._datasets[path], rows)

    def _cover(self) -> list[Row]:
        """Return the digests of all rows since the last ones."""
        uncovered, self._uncovered = self._uncovered, {}
        for path, rows in uncovered.items():
            self._digests.add(path, np.concatenate(rows) if len(rows) > 1 else rows[0])
        return self._digests.take_rows() if self._layout.has_digests else []


_RENAMES_OPEN_FILES = os.name == "posix"
"""Windows does not."""


def _temporary_path(path: Path) -> Path:
    """Return a part's name until readers may open it."""
    return layout.begun_path(path) if _RENAMES_OPEN_FILES else path


def _write_new(path: Path, image: bytes) -> None:
    """Write an empty part without HDF5, which crashes if the disk fills meanwhile."""
    if path.exists():
        raise FileExistsError(errno.EEXIST, "a part is never written twice", str(path))
    begun = layout.begun_path(path)
    try:
        begun.write_bytes(image)
    except OSError:
        os.truncate(begun, 0)
        raise
    if not _RENAMES_OPEN_FILES:
        begun.rename(path)


def _append(dataset: Any, rows: NDArray[Any]) -> Any:
    """Append rows by HDF5's own calls: with h5py's indexing they would cost three times as much."""
    identifier = dataset.id
    start = identifier.shape[0]
    identifier.set_extent((start + rows.shape[0], *rows.shape[1:]))
    place = identifier.get_space()
    place.select_hyperslab((start, *(0,) * (rows.ndim - 1)), rows.shape)
    identifier.write(h5py.h5s.create_simple(rows.shape), place, np.ascontiguousarray(rows))
    return dataset


def _leads_to(path: Path, descriptor: int) -> bool:
    """Return whether a path is the name of an open file, on the same device."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except OSError:
        return False


def _save_again(path: Path, descriptor: int) -> str:
    """Write the contents of an open file that lost its name to a new file; say where they are."""
    target = path if not path.exists() else path.with_suffix(".saved")
    try:
        os.lseek(descriptor, 0, os.SEEK_SET)
        with target.open("xb") as copy:
            while block := os.read(descriptor, COPY_BYTES):
                copy.write(block)
            os.fsync(copy.fileno())
    except OSError as error:
        return f"what it held could not be saved ({error.strerror})"
    return f"what it held is in {target}"


RESUME = "resume the session"
"""The end of a remedy; an import, which cannot be resumed, has another."""
_REMEDIES = {
    errno.ENOSPC: f"the disk is full: make room, then {RESUME}",
    errno.EDQUOT: f"your disk quota is used up: make room, then {RESUME}",
    errno.EROFS: f"the disk is read-only: check or replace it, then {RESUME}",
    errno.EACCES: f"the folder is not writable: check its permissions, then {RESUME}",
    errno.EFBIG: f"the file may not grow further (file size limit): lift it, then {RESUME}",
    errno.EIO: f"the disk reports an error: check or replace it, then {RESUME}",
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


@dataclass(frozen=True, slots=True)
class SessionHistory:
    """The number of the last part, the last digest that can be read, and the committed trials."""

    last_part: int = 0
    last_digest: str = FIRST_DIGEST
    committed: frozenset[int] = frozenset()


class SessionWriter:
    """Writer of a session's parts. Each flush replaces ``status`` as a whole.

    ``closing_digest`` is the last digest of the session, empty until :meth:`end_session`;
    ``texture`` is that of the newest part.
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
        self.texture = ""
        self._last_at_s = header.start_loop_s
        self._closed_samples = self._closed_bytes = 0
        self._sync_due = False
        self._flushes = 0
        self.closing_digest = ""
        self.status = self._read_status()

    def begin_part(self, reason: str, texture: str, header: SessionHeader | None = None) -> None:
        """Close the open part and create the next, with another ``header`` if one is given."""
        path = self._folder / layout.part_name(self._number + 1)
        layout.begun_path(path).touch()  # before the open part says that another one followed it
        self.close_part()
        self._header = header or self._header
        self._number += 1
        self.texture = texture
        attributes: Attributes = {
            "layout": layout.LAYOUT,
            "layout_version": layout.LAYOUT_VERSION,
            **self._header.to_attributes(),
        }
        self._part = PartWriter(
            path,
            self._layout,
            attributes,
            self._header.n_taxels,
            self._texts,
            self._last_digest,
            {"part": self._number, "reason": reason, "texture": texture},
        )
        self.flush()

    def add_block(self, block: SampleBlock) -> None:
        """Add samples; a lower counter means that the board restarted and begins a new part."""
        part = self._open_part(block.arrived_s)
        expected = part.counters.next_counter
        if len(block) and expected is not None and block.counters[0] < expected:
            self.begin_part(f"the {self._layout.board} restarted", self.texture)
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
            self._flushes += 1
            self._part.write(self._sync_due or self._flushes % FLUSHES_A_DIGEST == 0)
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
        self.close_part()
        self.closing_digest = self._last_digest

    def close_part(self) -> None:
        """Close the open part with an event as its last row; nothing writes to it again."""
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

    def _read_status(self) -> RecorderStatus:
        part = self._part
        return RecorderStatus(
            part=self._number,
            samples_on_disk=self._closed_samples + (part.samples_written if part else 0),
            bytes_on_disk=self._closed_bytes + (part.size_bytes() if part else 0),
            disk_free_bytes=shutil.disk_usage(self._folder).free,
        )


PROBE_BYTES = 1 << 20


def probe_disk(folder: Path) -> None:
    """Write, sync and remove a file of a megabyte. Raises OSError while the disk refuses."""
    path = folder / "probe.tmp"
    try:
        with path.open("wb") as file:
            file.write(bytes(PROBE_BYTES))
            file.flush()
            os.fsync(file.fileno())
    finally:
        path.unlink(missing_ok=True)


def may_pass(error: BaseException) -> bool:
    """Return whether it is the disk that refused: room, a repair or a remount may end that."""
    return not isinstance(error, DiskFault) and system_error(error) in _REMEDIES


def failure_message(error: BaseException, folder: Path) -> str:
    """Return a sentence with the remedy for the error that stopped the writer."""
    if isinstance(error, DiskFault):
        return f"Recording into {folder} stopped: {error}."
    code = system_error(error)
    if code in _REMEDIES:
        return f"Recording into {folder} stopped, {_REMEDIES[code]}."
    detail = os.strerror(code) if code else f"{type(error).__name__}: {error}"
    return f"Recording into {folder} stopped: {detail}. Committed trials are safe."
