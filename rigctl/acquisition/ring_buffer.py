"""A ring of rows in a memory-mapped file: one process writes, any number read, none waits.

The writer first stores how far it is about to write (``reserved``), then writes the rows, then
stores that they are complete (``head``). A reader copies the rows it wants and reads ``reserved``
afterwards: the rows that the writer may have changed meanwhile are the oldest ones, and the reader
drops them. Both numbers count rows since the file was created, are aligned 64-bit words and never
wrap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

ALIGNMENT_BYTES = 64
_COUNTERS_BYTES = 64


class RingColumn(NamedTuple):
    """One column of a ring: its name, element type and elements per row."""

    name: str
    dtype: DTypeLike
    width: int = 1


class RingBuffer:
    """Rows of a few columns inside a buffer that processes share."""

    def __init__(self, buffer: Any, offset: int, rows: int, columns: Sequence[RingColumn]) -> None:
        self.rows = rows
        self._counters = np.frombuffer(buffer, dtype=np.int64, count=2, offset=offset)
        self._columns = dict(_views(buffer, offset + _COUNTERS_BYTES, rows, columns))

    @property
    def head(self) -> int:
        """Rows written since the file was created."""
        return int(self._counters[1])

    @property
    def reserved(self) -> int:
        """Rows written or being written since the file was created."""
        return int(self._counters[0])

    def append(self, count: int, **values: NDArray[Any] | float) -> None:
        """Add ``count`` rows, oldest first: for each column an array, or one value for all."""
        if count > self.rows:
            values = {
                name: _slice(value, count - self.rows, count) for name, value in values.items()
            }
            count = self.rows
        head = self.head
        self._counters[0] = head + count
        start = head % self.rows
        first = min(count, self.rows - start)
        for name, column in self._columns.items():
            column[start : start + first] = _slice(values[name], 0, first)
            if count > first:
                column[: count - first] = _slice(values[name], first, count)
        self._counters[1] = head + count

    def newest(self, n: int) -> tuple[int, Mapping[str, NDArray[Any]]]:
        """Return the number of the first row, and copies of the newest ``n`` rows or fewer."""
        head = self.head
        first = max(0, head - n, self.reserved - self.rows)
        copies = {name: self._copy(column, first, head) for name, column in self._columns.items()}
        safe = min(head, max(first, self.reserved - self.rows))
        if safe > first:
            copies = {name: copy[safe - first :] for name, copy in copies.items()}
        return safe, copies

    def release(self) -> None:
        """Drop all views of the buffer, so that it can be closed."""
        self._counters = np.zeros(2, dtype=np.int64)
        self._columns = {}

    def _copy(self, column: NDArray[Any], first: int, head: int) -> NDArray[Any]:
        start = first % self.rows
        count = max(0, head - first)
        if start + count <= self.rows:
            return column[start : start + count].copy()
        return np.concatenate((column[start:], column[: start + count - self.rows]))


def _slice(value: NDArray[Any] | float, start: int, stop: int) -> NDArray[Any] | float:
    return value[start:stop] if isinstance(value, np.ndarray) else value


def ring_bytes(rows: int, columns: Sequence[RingColumn]) -> int:
    """Return the size of a ring in bytes."""
    return _COUNTERS_BYTES + sum(_column_bytes(rows, column) for column in columns)


def _views(
    buffer: Any, offset: int, rows: int, columns: Sequence[RingColumn]
) -> Iterator[tuple[str, NDArray[Any]]]:
    for column in columns:
        count = rows * column.width
        flat = np.frombuffer(buffer, dtype=column.dtype, count=count, offset=offset)
        yield column.name, flat if column.width == 1 else flat.reshape(rows, column.width)
        offset += _column_bytes(rows, column)


def _column_bytes(rows: int, column: RingColumn) -> int:
    """Return the size of one column, rounded up to the alignment."""
    size = rows * column.width * np.dtype(column.dtype).itemsize
    return -(-size // ALIGNMENT_BYTES) * ALIGNMENT_BYTES
