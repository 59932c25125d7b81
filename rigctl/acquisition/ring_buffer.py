"""A ring of rows in a memory-mapped file: one process writes, any number read, none waits.

The writer first stores how far it is about to write (``reserved``), then writes the rows, then
stores that they are complete (``head``). A reader copies the rows it wants and reads ``reserved``
afterwards: the rows that the writer may have changed meanwhile are the oldest ones, and the reader
drops them. Both numbers count rows since the file was created, are aligned 64-bit words and never
wrap.
"""

from __future__ import annotations

import mmap
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

ALIGNMENT_BYTES = 64
_COUNTERS_BYTES = 64

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
