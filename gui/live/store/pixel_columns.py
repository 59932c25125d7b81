"""Pixel columns over a time axis: which samples each one shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class PixelColumns:
    """Adjacent pixel columns; column ``i`` shows the rows ``start[i]:start[i + 1]``.

    ``number``: int64 (k,), absolute column numbers, ascending by one.
    ``start``: int64 (k + 1,), row numbers.
    ``missing``: bool (k,), columns whose samples are lost.
    ``blank``: bool (k,), columns before the first and after the last sample.
    ``samples_a_column``: length of a column.
    """

    number: NDArray[np.int64]
    start: NDArray[np.int64]
    missing: NDArray[np.bool_]
    blank: NDArray[np.bool_]
    samples_a_column: float


def reduce_columns(start: NDArray[np.int64], values: NDArray[Any], ufunc: np.ufunc) -> NDArray[Any]:
    """Return one row per column, reduced by ``ufunc``; an empty column repeats the last one.

    ``start``: int64 (k + 1,), ascending; ``values``: the rows ``start[0]:start[-1]``.
    """
    filled = np.flatnonzero(start[1:] != start[:-1])
    if not len(filled):
        return np.zeros((len(start) - 1, values.shape[1]), values.dtype)
    reduced = ufunc.reduceat(values, start[filled] - start[0], axis=0)
    source = np.searchsorted(filled, np.arange(len(start) - 1), side="right") - 1
    return np.asarray(reduced[np.maximum(source, 0)], values.dtype)
