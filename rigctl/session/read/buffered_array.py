"""Long arrays read in large blocks, for windows that follow each other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from numpy.typing import NDArray

READ_AHEAD_ROWS = 500_000
_READ_BEHIND_ROWS = 8
"""Callers often read a window again from a few rows before it."""


Read = Callable[[int, int], NDArray[Any]]
"""Returns rows [start, stop) of an array."""


def read_blocks(read: Read, n_rows: int) -> Iterator[tuple[int, NDArray[Any]]]:
    """Read a whole array in blocks; yield each one's first row and its rows."""
    for start in range(0, n_rows, READ_AHEAD_ROWS):
        yield start, read(start, min(n_rows, start + READ_AHEAD_ROWS))


class BufferedArray:
    """Windows of an array of ``n_rows``.

    The buffer serves the windows that follow, so it reads each row about once and holds no more
    than ``READ_AHEAD_ROWS`` or the longest window.
    """

    def __init__(self, read: Read, n_rows: int) -> None:
        self._read = read
        self._n_rows = n_rows
        self._first = 0
        self._rows: NDArray[Any] | None = None

    def window(self, start: int, stop: int) -> NDArray[Any]:
        """Return rows ``start`` … ``stop`` - 1, cut at the array's end; do not write to them."""
        stop = min(stop, self._n_rows)
        rows = self._rows
        if rows is None or start < self._first or stop > self._first + len(rows):
            self._first = max(0, start - _READ_BEHIND_ROWS)
            read_to = min(self._n_rows, self._first + READ_AHEAD_ROWS)
            rows = self._rows = self._read(self._first, max(stop, read_to))
        return rows[start - self._first : max(start, stop) - self._first]
