"""Live data in memory that processes share: the engine writes it, windows read it.

The file holds the last half minute of taxel samples with their spikes and the last minutes of
load-cell samples, each in a ring of rows. A reader never blocks the writer, and never sees a
half-written row: the writer first stores how far it is about to write (``reserved``), then writes
the rows, then stores that they are complete (``head``). A reader copies the rows it wants and reads
``reserved`` afterwards: the rows that the writer may have changed meanwhile are the oldest ones,
and the reader drops them. Both numbers count rows since the file was created, are aligned 64-bit
words and never wrap.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import RigFault
from rigctl.values import N_TAXELS

MAGIC = 0x3145_5649_4C47_4952  # "RIGLIVE1", low byte first
TAXEL_ROWS = 1 << 15
DRUM_ROWS = 1 << 13
ALIGNMENT_BYTES = 64
_HEADER_BYTES = 1024
_HEADER_WORDS = 8  # magic, taxels, taxel rows, drum rows, version of the range, three spare
_RANGE_OFFSET = 64
_COUNTERS_BYTES = 64
_RANGE_TRIES = 1000
_NEW_FILE = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)

RingColumns = Mapping[str, np.dtype[Any]]
"""The element type of each column by name; a subarray type has several elements per row."""


class RingBuffer:
    """Rows of a few columns inside memory that processes share."""

    def __init__(self, memory: mmap.mmap, offset: int, rows: int, columns: RingColumns) -> None:
        self.rows = rows
        self._counters = np.ndarray(2, np.int64, memory, offset)
        self._columns: dict[str, NDArray[Any]] = {}
        offset += _COUNTERS_BYTES
        for name, dtype in columns.items():
            self._columns[name] = np.ndarray((rows, *dtype.shape), dtype.base, memory, offset)
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
        start = head % self.rows
        first = min(count, self.rows - start)
        for name, column in self._columns.items():
            value = values[name]
            column[start : start + first] = (
                value[:first] if isinstance(value, np.ndarray) else value
            )
            if count > first:
                column[: count - first] = value[first:] if isinstance(value, np.ndarray) else value
        self._counters[1] = head + count

    def newest(self, n: int) -> tuple[int, dict[str, NDArray[Any]]]:
        """Return the number of the first row, and copies of the newest ``n`` rows or fewer."""
        head = self.head
        first = max(0, head - n, self.reserved - self.rows)
        copies = {name: self._copy(column, first, head) for name, column in self._columns.items()}
        safe = min(head, max(first, self.reserved - self.rows))
        return safe, {name: copy[safe - first :] for name, copy in copies.items()}

    def _copy(self, column: NDArray[Any], first: int, head: int) -> NDArray[Any]:
        start = first % self.rows
        end = start + max(0, head - first)
        if end <= self.rows:
            return column[start:end].copy()
        return np.concatenate((column[start:], column[: end - self.rows]))


def ring_bytes(rows: int, columns: RingColumns) -> int:
    """Return the size of a ring in bytes."""
    return _COUNTERS_BYTES + sum(_column_bytes(rows, dtype) for dtype in columns.values())


def _column_bytes(rows: int, dtype: np.dtype[Any]) -> int:
    """Return the size of one column, rounded up to the alignment."""
    return -(-rows * dtype.itemsize // ALIGNMENT_BYTES) * ALIGNMENT_BYTES


@dataclass(frozen=True, slots=True)
class _RingWindow:
    """Newest rows of a ring, oldest first, copied out of it.

    ``first``: row number of the first one in the stream of all rows written.
    ``time_s``: float64 (n,), loop time of each row.
    """

    first: int
    time_s: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True)
class TaxelWindow(_RingWindow):
    """Newest taxel samples; their times are smoothed over arrival jitter.

    ``counters``: int64 (n,), the board's sample numbers; a step other than 1 is a gap.
    ``samples``: uint16 (n, n_taxels). ``flags``: uint8 (n,), bits of the taxel wire.
    ``spikes``: uint8 (n, 2·n_taxels), spikes in each sample: SA taxel 1…n, then RA 1…n.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    spikes: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class DrumWindow(_RingWindow):
    """Newest load-cell samples with the drum's set-points.

    All (n,): ``force_g``, ``force_set_g``, ``speed_mm_s``, ``speed_set_mm_s`` float64, ``state``
    uint8 (value of ``State``).
    """

    force_g: NDArray[np.float64]
    force_set_g: NDArray[np.float64]
    speed_mm_s: NDArray[np.float64]
    speed_set_mm_s: NDArray[np.float64]
    state: NDArray[np.uint8]


def _taxel_columns(n_taxels: int) -> RingColumns:
    return {
        "time_s": np.dtype(np.float64),
        "counters": np.dtype(np.int64),
        "samples": np.dtype((np.uint16, n_taxels)),
        "flags": np.dtype(np.uint8),
        "spikes": np.dtype((np.uint8, 2 * n_taxels)),
    }


_DRUM_COLUMNS: RingColumns = {
    **dict.fromkeys(
        ("time_s", "force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s"), np.dtype(np.float64)
    ),
    "state": np.dtype(np.uint8),
}


class _LiveFile:
    """Views of the file's parts, for the writer and for readers."""

    def __init__(self, memory: mmap.mmap, n_taxels: int, taxel_rows: int, drum_rows: int) -> None:
        columns = _taxel_columns(n_taxels)
        self.header = np.ndarray(_HEADER_WORDS, np.int64, memory)
        self.range = np.ndarray((2, n_taxels), np.uint16, memory, _RANGE_OFFSET)
        self.taxels = RingBuffer(memory, _HEADER_BYTES, taxel_rows, columns)
        drum_offset = _HEADER_BYTES + ring_bytes(taxel_rows, columns)
        self.drum = RingBuffer(memory, drum_offset, drum_rows, _DRUM_COLUMNS)
        self._memory = memory

    def close(self) -> None:
        del self.header, self.range, self.taxels, self.drum  # mapped memory in use cannot be closed
        self._memory.close()


class LiveWriter:
    """The engine's side: creates the file and appends rows."""

    def __init__(
        self, path: Path, taxel_rows: int = TAXEL_ROWS, drum_rows: int = DRUM_ROWS
    ) -> None:
        self.path = path
        size = _HEADER_BYTES + ring_bytes(taxel_rows, _taxel_columns(N_TAXELS))
        size += ring_bytes(drum_rows, _DRUM_COLUMNS)
        descriptor = os.open(path, _NEW_FILE, 0o600)
        try:
            os.ftruncate(descriptor, size)
            memory = mmap.mmap(descriptor, size)
        finally:
            os.close(descriptor)
        self._file = _LiveFile(memory, N_TAXELS, taxel_rows, drum_rows)
        self._file.header[1:5] = (N_TAXELS, taxel_rows, drum_rows, 0)
        self._file.header[0] = MAGIC

    def set_range(self, low: NDArray[np.uint16], high: NDArray[np.uint16]) -> None:
        """Store the readings that the encoder maps to 0 and 1; an odd version marks the write."""
        self._file.header[4] += 1
        self._file.range[:] = (low, high)
        self._file.header[4] += 1

    def add_taxels(self, **columns: NDArray[np.generic]) -> None:
        """Append samples, oldest first, with the columns of :class:`TaxelWindow`."""
        self._file.taxels.append(len(columns["time_s"]), **columns)

    def add_drum(self, time_s: NDArray[np.float64], **columns: NDArray[np.float64] | float) -> None:
        """Append the load-cell samples of one poll, with the columns of :class:`DrumWindow`."""
        self._file.drum.append(len(time_s), time_s=time_s, **columns)

    def close(self) -> None:
        """Remove the file; readers that have it open keep their data."""
        self._file.close()
        self.path.unlink(missing_ok=True)


class LiveReader:
    """A window's side: copies of the newest rows at any time."""

    def __init__(self, path: Path) -> None:
        sizes = _read_sizes(path)
        with path.open("rb") as file:
            memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._file = _LiveFile(memory, *sizes)

    @property
    def taxel_head(self) -> int:
        """Taxel samples written since the engine started."""
        return self._file.taxels.head

    @property
    def normalisation(self) -> NDArray[np.uint16]:
        """Readings that the live encoder maps to 0 and 1, uint16 (2, n_taxels)."""
        for _ in range(_RANGE_TRIES):  # a killed engine may leave the version odd
            version = int(self._file.header[4])
            limits = self._file.range.copy()
            if version % 2 == 0 and int(self._file.header[4]) == version:
                break
        return limits

    def taxels(self, n: int) -> TaxelWindow:
        """Return the newest ``n`` samples, or all if there are fewer."""
        first, rows = self._file.taxels.newest(n)
        return TaxelWindow(first, **rows)

    def drum(self, n: int) -> DrumWindow:
        """Return the newest ``n`` load-cell samples, or all if there are fewer."""
        first, rows = self._file.drum.newest(n)
        return DrumWindow(first, **rows)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _read_sizes(path: Path) -> tuple[int, int, int]:
    """Return taxels, taxel rows and drum rows. Raises RigFault where it is no live-data file."""
    try:
        with path.open("rb") as file:
            words = np.frombuffer(file.read(8 * _HEADER_WORDS), dtype=np.int64)
    except OSError as error:
        raise RigFault(
            f"live data {path} cannot be opened ({error.strerror}): check that the engine runs"
        ) from error
    if len(words) < _HEADER_WORDS or words[0] != MAGIC:
        raise RigFault(f"{path} holds no live data of this version: restart the engine")
    return int(words[1]), int(words[2]), int(words[3])
