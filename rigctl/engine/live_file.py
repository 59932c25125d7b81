"""A file in memory that processes share: rings of rows, written by one process, read by others.

A reader never blocks the writer, and never sees a half-written row: the writer first stores how far
it is about to write (``reserved``), then writes the rows, then stores that they are complete
(``head``). A reader copies the rows it wants and reads ``reserved`` afterwards: the rows that the
writer may have changed meanwhile are the oldest ones, and the reader drops them. Both numbers count
rows since the file was created, are aligned 64-bit words and never wrap.
"""

from __future__ import annotations

import errno
import mmap
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import MAX_TAXELS
from rigctl.errors import DiskFault, RigFault

ALIGNMENT_BYTES = 64
_HEADER_WORDS = 8  # magic, taxels, rows of both rings, version of the range, three spare
_RANGE_OFFSET = 64
_COUNTERS_BYTES = 64
_RANGE_TRIES = 1000
_NO_FALLOCATE = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)
_ZEROS = bytes(1 << 20)
_NEW_FILE = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)

RingColumns = Mapping[str, np.dtype[Any]]
"""The element type of each column by name; a subarray type has several elements per row."""


class Ring:
    """The newest rows of one column. A row's number counts from the first row ever appended.

    ``capacity``: rows kept. ``dtype``: of a row; a subarray type has several elements.
    Memory is its own, used as rows arrive and never beyond the capacity, or at ``offset`` of
    ``memory``, whose owner says which rows are in it.
    """

    def __init__(
        self,
        capacity: int,
        dtype: np.dtype[Any],
        memory: mmap.mmap | None = None,
        offset: int = 0,
    ) -> None:
        self.capacity = capacity
        shape = (capacity, *dtype.shape)
        if memory is None:
            self._rows = np.zeros(shape, dtype.base)
        else:
            self._rows = np.ndarray(shape, dtype.base, memory, offset)
        self.end = 0

    def clear(self) -> None:
        """Remove all rows; the numbers begin at 0 again."""
        self.end = 0

    @property
    def first(self) -> int:
        """Number of the oldest row."""
        return max(0, self.end - self.capacity)

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows, oldest first."""
        kept = rows[max(0, len(rows) - self.capacity) :]
        self.end += len(rows)
        self.put(self.end - len(kept), len(kept), kept)

    def put(self, first: int, count: int, rows: NDArray[Any] | float) -> None:
        """Store rows, or one value for all, from number ``first`` on, at most the capacity."""
        begin = first % self.capacity
        if begin + count <= self.capacity:
            self._rows[begin : begin + count] = rows
            return
        each = np.broadcast_to(rows, (count, *self._rows.shape[1:]))
        n_before_seam = self.capacity - begin
        self._rows[begin:] = each[:n_before_seam]
        self._rows[: count - n_before_seam] = each[n_before_seam:]

    def between(self, first: int, end: int) -> NDArray[Any]:
        """Return the rows ``first`` … ``end - 1``: a view, or a copy where they cross the seam."""
        first = max(first, self.first)
        return self.get(first, max(first, min(end, self.end)))

    def get(self, first: int, end: int) -> NDArray[Any]:
        """Return as :meth:`between` rows that the ring must have."""
        n = end - first
        begin = first % self.capacity
        if begin + n <= self.capacity:
            return self._rows[begin : begin + n]
        return np.concatenate((self._rows[begin:], self._rows[: begin + n - self.capacity]))

    def take(self, rows: NDArray[np.int64]) -> NDArray[Any]:
        """Return some rows by their numbers, which the ring must have."""
        return np.asarray(self._rows[rows % self.capacity])

    def count_below(self, values: NDArray[Any]) -> NDArray[np.int64]:
        """Return the number of the first row at or above each value; the rows ascend."""
        seam = max(self.first, self.end - self.end % self.capacity)
        older, newer = self.between(self.first, seam), self.between(seam, self.end)
        below = np.searchsorted(older, values) + np.searchsorted(newer, values)
        return np.asarray(self.first + below, np.int64)


class RingBuffer:
    """Rows of a few columns inside memory that processes share."""

    def __init__(self, memory: mmap.mmap, offset: int, rows: int, columns: RingColumns) -> None:
        self.rows = rows
        self._counters = np.ndarray(2, np.int64, memory, offset)
        self._columns: dict[str, Ring] = {}
        offset += _COUNTERS_BYTES
        for name, dtype in columns.items():
            self._columns[name] = Ring(rows, dtype, memory, offset)
            offset += _column_bytes(rows, dtype)

    @property
    def head(self) -> int:
        """Rows written since the file was created."""
        return int(self._counters[1])

    @property
    def reserved(self) -> int:
        """Rows written or being written since the file was created."""
        return int(self._counters[0])

    def append(self, count: int, **values: NDArray[Any] | float) -> None:
        """Add ``count`` rows, oldest first, at most :attr:`rows`.

        ``values``: for each column an array, or one value for all rows.
        """
        head = self.head
        self._counters[0] = head + count
        for name, column in self._columns.items():
            column.put(head, count, values[name])
        self._counters[1] = head + count

    def newest(self, n: int) -> tuple[int, dict[str, NDArray[Any]]]:
        """Return the number of the first row, and copies of the newest ``n`` rows or fewer."""
        return self.since(self.head - n)

    def since(self, number: int) -> tuple[int, dict[str, NDArray[Any]]]:
        """Return as :meth:`newest` the rows from a number on that are still here."""
        head = self.head
        first = max(0, number, self.reserved - self.rows)
        copies = {
            name: column.get(first, max(first, head)).copy()
            for name, column in self._columns.items()
        }
        safe = min(head, max(first, self.reserved - self.rows))
        return safe, {name: copy[safe - first :] for name, copy in copies.items()}


def ring_bytes(rows: int, columns: RingColumns) -> int:
    """Return the size of a ring in bytes."""
    return _COUNTERS_BYTES + sum(_column_bytes(rows, dtype) for dtype in columns.values())


def _column_bytes(rows: int, dtype: np.dtype[Any]) -> int:
    """Return the size of one column, rounded up to the alignment."""
    return -(-rows * dtype.itemsize // ALIGNMENT_BYTES) * ALIGNMENT_BYTES


@dataclass(frozen=True, slots=True)
class RingWindow:
    """Newest rows of a ring, oldest first, copied out of it.

    ``first``: row number of the first one in the stream of all rows written.
    ``time_s``: float64 (n,), loop time of each row.
    """

    first: int
    time_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True)
class TaxelWindow(RingWindow):
    """Newest taxel samples; their times are smoothed over arrival jitter.

    ``counters``: int64 (n,), the board's sample numbers; a step other than 1 is a gap.
    ``samples``: uint16 (n, n_taxels). ``flags``: uint8 (n,), bits of the board's wire.
    ``spikes``: uint8 (n, trains), spikes in each sample: of the drum's sensor SA taxel 1…n, then
    RA 1…n; of the finger's one train a taxel.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    spikes: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LiveLayout:
    """Two rings and their columns: the taxels' and another one. ``magic`` names the layout.

    :data:`LayoutOf` returns it for the number of taxels, which the file's header holds.
    """

    magic: int
    n_taxels: int
    taxel_columns: RingColumns
    other_columns: RingColumns


LayoutOf = Callable[[int], LiveLayout]


class LiveFile:
    """Views of the file's parts, for the writer and for readers."""

    def __init__(
        self, memory: mmap.mmap, layout: LiveLayout, taxel_rows: int, other_rows: int
    ) -> None:
        self.header = np.ndarray(_HEADER_WORDS, np.int64, memory)
        self.range = np.ndarray((2, layout.n_taxels), np.uint16, memory, _RANGE_OFFSET)
        offset = _header_bytes(layout)
        self.taxels = RingBuffer(memory, offset, taxel_rows, layout.taxel_columns)
        offset += ring_bytes(taxel_rows, layout.taxel_columns)
        self.other = RingBuffer(memory, offset, other_rows, layout.other_columns)
        self._memory = memory

    @classmethod
    def create(cls, path: Path, layout: LiveLayout, taxel_rows: int, other_rows: int) -> Self:
        """Create the file. Raises DiskFault where there is no room for all of it."""
        size = _file_bytes(layout, taxel_rows, other_rows)
        try:
            memory = _create_memory(path, size)
        except OSError as error:
            raise DiskFault(
                f"live data {path} need {size / 1e6:.0f} MB and cannot be created "
                f"({error.strerror}): make room there, or set RIGCTL_RUNTIME to another folder"
            ) from error
        file = cls(memory, layout, taxel_rows, other_rows)
        file.header[1:5] = (layout.n_taxels, taxel_rows, other_rows, 0)
        file.header[0] = layout.magic
        return file

    @classmethod
    def open(cls, path: Path, layout_of: LayoutOf) -> Self:
        """Open the file of an engine. Raises RigFault where it is absent or has another layout."""
        try:
            with path.open("rb") as file:
                layout, taxel_rows, other_rows = _read_layout(path, file, layout_of)
                size = _file_bytes(layout, taxel_rows, other_rows)
                memory = mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ)
        except OSError as error:
            raise RigFault(
                f"live data {path} cannot be opened ({error.strerror}): check that the engine runs"
            ) from error
        return cls(memory, layout, taxel_rows, other_rows)

    def set_range(self, low: NDArray[np.uint16], high: NDArray[np.uint16]) -> None:
        """Store the readings that the encoder maps to 0 and 1; an odd version marks the write."""
        self.header[4] += 1
        self.range[:] = (low, high)
        self.header[4] += 1

    def copy_range(self) -> NDArray[np.uint16]:
        """Return the readings that the encoder maps to 0 and 1, uint16 (2, n_taxels)."""
        for _ in range(_RANGE_TRIES):  # a killed engine may leave the version odd
            version = int(self.header[4])
            limits = self.range.copy()
            if version % 2 == 0 and int(self.header[4]) == version:
                break
        return limits

    def close(self) -> None:
        """Unmap the file."""
        del self.header, self.range, self.taxels, self.other  # mapped memory in use stays mapped
        self._memory.close()


class LiveFileWriter:
    """The engine's side: creates the file and appends rows; a subclass those of the other ring."""

    def __init__(self, path: Path, layout: LiveLayout, taxel_rows: int, other_rows: int) -> None:
        self.path = path
        self._file = LiveFile.create(path, layout, taxel_rows, other_rows)

    def add_taxels(self, **columns: NDArray[np.generic]) -> None:
        """Append samples, oldest first, with the columns of :class:`TaxelWindow`."""
        self._file.taxels.append(len(columns["time_s"]), **columns)

    def set_range(self, low: NDArray[np.uint16], high: NDArray[np.uint16]) -> None:
        """Store the readings that the neurons map to 0 and 1."""
        self._file.set_range(low, high)

    def close(self) -> None:
        """Remove the file; readers that have it open keep their data."""
        self._file.close()
        self.path.unlink(missing_ok=True)


class LiveFileReader:
    """A window's side: copies of the newest rows at any time; a subclass has the other ring's."""

    def __init__(self, path: Path, layout_of: LayoutOf) -> None:
        self._file = LiveFile.open(path, layout_of)

    @property
    def n_taxels(self) -> int:
        """Taxels of the engine's sensor."""
        return int(self._file.range.shape[1])

    @property
    def taxel_head(self) -> int:
        """Taxel samples written since the engine started."""
        return self._file.taxels.head

    def taxels(self, n: int) -> TaxelWindow:
        """Return the newest ``n`` samples, or all if there are fewer."""
        return self.taxels_since(self.taxel_head - n)

    def taxels_since(self, number: int) -> TaxelWindow:
        """Return the samples from a number of :attr:`taxel_head` on that are still here."""
        first, rows = self._file.taxels.since(number)
        return TaxelWindow(first, **rows)

    @property
    def normalisation(self) -> NDArray[np.uint16]:
        """Readings that the neurons map to 0 and 1, uint16 (2, n_taxels)."""
        return self._file.copy_range()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _file_bytes(layout: LiveLayout, taxel_rows: int, other_rows: int) -> int:
    """Return the size of the file."""
    rings = (
        ring_bytes(taxel_rows, layout.taxel_columns),
        ring_bytes(other_rows, layout.other_columns),
    )
    return _header_bytes(layout) + sum(rings)


def _header_bytes(layout: LiveLayout) -> int:
    """Return the bytes before the rings: words, and the range of each taxel."""
    return _RANGE_OFFSET + _column_bytes(2, np.dtype((np.uint16, layout.n_taxels)))


def _create_memory(path: Path, size: int) -> mmap.mmap:
    """Return the memory of a new file that has all its space.

    A write into space that a full disk cannot give later would end the process by SIGBUS.
    """
    descriptor = os.open(path, _NEW_FILE, 0o600)
    try:
        _allocate(descriptor, size)
        return mmap.mmap(descriptor, size)
    except OSError:
        path.unlink()
        raise
    finally:
        os.close(descriptor)


def _allocate(descriptor: int, size: int) -> None:
    """Give a new file its space, by zeros where the system has no call for it."""
    if hasattr(os, "posix_fallocate"):
        try:
            os.posix_fallocate(descriptor, 0, size)
            return
        except OSError as error:
            if error.errno not in _NO_FALLOCATE:
                raise
    for start in range(0, size, len(_ZEROS)):
        unwritten = memoryview(_ZEROS)[: size - start]
        while unwritten:
            unwritten = unwritten[os.write(descriptor, unwritten) :]


def _read_layout(path: Path, file: BinaryIO, layout_of: LayoutOf) -> tuple[LiveLayout, int, int]:
    """Return layout and rows of both rings. Raises RigFault where it is no live-data file."""
    data = file.read(8 * _HEADER_WORDS)
    words = np.frombuffer(data.ljust(8 * _HEADER_WORDS, b"\0"), dtype=np.int64)
    magic, n_taxels, taxel_rows, other_rows = map(int, words[:4])
    if 1 <= n_taxels <= MAX_TAXELS:
        layout = layout_of(n_taxels)
        size = os.fstat(file.fileno()).st_size
        fits = _file_bytes(layout, taxel_rows, other_rows) == size
        if magic == layout.magic and fits and taxel_rows > 0 and other_rows > 0:
            return layout, taxel_rows, other_rows
    raise RigFault(f"{path} holds no live data of this version: restart the engine")


MAGIC = 0x3145_5649_4C47_4952  # "RIGLIVE1", low byte first
TAXEL_ROWS = 1 << 15
DRUM_ROWS = 1 << 13


def taxel_columns(n_taxels: int, trains_per_taxel: int) -> RingColumns:
    """Return the columns of a ring of samples, of the drum's sensor or the finger's."""
    return {
        "time_s": np.dtype(np.float64),
        "counters": np.dtype(np.int64),
        "samples": np.dtype((np.uint16, n_taxels)),
        "flags": np.dtype(np.uint8),
        "spikes": np.dtype((np.uint8, trains_per_taxel * n_taxels)),
    }


def drum_live(n_taxels: int) -> LiveLayout:
    """Return the layout of the drum's live data."""
    numbers = ("time_s", "force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s")
    drum: RingColumns = {
        **dict.fromkeys(numbers, np.dtype(np.float64)),
        "state": np.dtype(np.uint8),
    }
    return LiveLayout(MAGIC, n_taxels, taxel_columns(n_taxels, 2), drum)


@dataclass(frozen=True, slots=True)
class DrumWindow(RingWindow):
    """Newest load-cell samples with the drum's set-points.

    All (n,): ``force_g``, ``force_set_g``, ``speed_mm_s``, ``speed_set_mm_s`` float64, ``state``
    uint8 (value of ``State``).
    """

    force_g: NDArray[np.float64]
    force_set_g: NDArray[np.float64]
    speed_mm_s: NDArray[np.float64]
    speed_set_mm_s: NDArray[np.float64]
    state: NDArray[np.uint8]


class LiveWriter(LiveFileWriter):
    """Live data of the drum, as its engine writes them."""

    def __init__(
        self, path: Path, n_taxels: int, taxel_rows: int = TAXEL_ROWS, drum_rows: int = DRUM_ROWS
    ) -> None:
        super().__init__(path, drum_live(n_taxels), taxel_rows, drum_rows)

    def add_drum(self, time_s: NDArray[np.float64], **columns: NDArray[np.float64] | float) -> None:
        """Append the load-cell samples of one poll, with the columns of :class:`DrumWindow`."""
        self._file.other.append(len(time_s), time_s=time_s, **columns)


class LiveReader(LiveFileReader):
    """Live data of the drum, as a window reads them."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, drum_live)

    def drum(self, n: int) -> DrumWindow:
        """Return the newest ``n`` load-cell samples, or all if there are fewer."""
        first, rows = self._file.other.newest(n)
        return DrumWindow(first, **rows)
