"""A column of the newest rows, of which the oldest make room."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Ring:
    """The newest rows of one column. A row's number counts from the first row ever appended.

    ``capacity``: rows kept. ``dtype``: of a row; a subarray type has several elements.
    Memory is used as rows arrive, and never grows beyond the capacity.
    """

    def __init__(self, capacity: int, dtype: np.dtype[Any]) -> None:
        self.capacity = capacity
        self._rows = np.zeros((capacity, *dtype.shape), dtype.base)
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
        n = len(rows)
        self.end += n
        kept = rows[max(0, n - self.capacity) :]
        begin = (self.end - len(kept)) % self.capacity
        n_before_seam = min(len(kept), self.capacity - begin)
        self._rows[begin : begin + n_before_seam] = kept[:n_before_seam]
        self._rows[: len(kept) - n_before_seam] = kept[n_before_seam:]

    def between(self, first: int, end: int) -> NDArray[Any]:
        """Return the rows ``first`` … ``end - 1``: a view, or a copy where they cross the seam."""
        first = max(first, self.first)
        n = max(0, min(end, self.end) - first)
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
