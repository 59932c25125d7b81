"""Long arrays read a stretch at a time, for whoever looks at windows that follow each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import NDArray

STRETCH_ROWS = 500_000
_LOOK_BACK_ROWS = 8
"""A window is often looked at once more from a few rows before it."""


class BufferedArray:
    """Windows of one array of ``n_rows``; ``read(start, stop)`` gives its rows.

    What was read serves the windows behind, so that each row is read about once and no more
    than a stretch, or the longest window, is held.
    """

    def __init__(self, read: Callable[[int, int], NDArray[Any]], n_rows: int) -> None:
        self._read = read
        self._n_rows = n_rows
        self._first = 0
        self._rows: NDArray[Any] | None = None

    def window(self, start: int, stop: int) -> NDArray[Any]:
        """Rows ``start`` … ``stop`` - 1, as far as there are some; not to be written to."""
        stop = min(stop, self._n_rows)
        rows = self._rows
        if rows is None or start < self._first or stop > self._first + len(rows):
            self._first = max(0, start - _LOOK_BACK_ROWS)
            behind = min(self._n_rows, self._first + STRETCH_ROWS)
            rows = self._rows = self._read(self._first, max(stop, behind))
        return rows[start - self._first : max(start, stop) - self._first]
