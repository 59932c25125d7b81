"""Per-sample spike counts to spike trains and to counts in windows."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.values import Spikes


def _totals(counts: Any, n: Any, first: Any, n_taxels: Any, row_start: Any) -> None:
    """Spikes of each train as a running sum: row_start int64 (2·n_taxels + 1,), zeros before."""
    half = counts.shape[1] // 2
    for t in range(n):
        for side in range(2):
            for j in range(n_taxels):
                row_start[1 + side * n_taxels + j] += counts[t, side * half + first + j]
    for row in range(2 * n_taxels):
        row_start[row + 1] += row_start[row]


def _fill(counts: Any, n: Any, first: Any, n_taxels: Any, at: Any, sample_index: Any) -> None:
    """Write every spike's sample index; ``at`` int64 (2·n_taxels,) holds the next free places."""
    half = counts.shape[1] // 2
    for t in range(n):
        for side in range(2):
            for j in range(n_taxels):
                for _ in range(counts[t, side * half + first + j]):
                    row = side * n_taxels + j
                    sample_index[at[row]] = t
                    at[row] += 1


def _windows(counts: Any, n: Any, first: Any, n_taxels: Any, window_of: Any, out: Any) -> None:
    """Add each sample's spikes to its window: out float64 (2·n_taxels, n_windows)."""
    half = counts.shape[1] // 2
    for t in range(n):
        window = window_of[t]
        if window >= out.shape[1]:
            break
        for side in range(2):
            for j in range(n_taxels):
                out[side * n_taxels + j, window] += counts[t, side * half + first + j]


_compile = numba.njit(cache=True, nogil=True)
_totals_compiled = _compile(_totals)
_fill_compiled = _compile(_fill)
_windows_compiled = _compile(_windows)


def to_spikes(counts: NDArray[np.uint8], n_samples: int, first_lane: int, n_taxels: int) -> Spikes:
    """Spike trains of one trial inside a raster, uint8 (n, 2·lanes): SA half, then RA half."""
    row_start = np.zeros(2 * n_taxels + 1, np.int64)
    _totals_compiled(counts, n_samples, first_lane, n_taxels, row_start)
    sample_index = np.empty(row_start[-1], np.int32)
    at = row_start[:-1].copy()
    _fill_compiled(counts, n_samples, first_lane, n_taxels, at, sample_index)
    return Spikes(row_start, sample_index, n_samples)


def window_counts(
    counts: NDArray[np.uint8],
    window_of: NDArray[np.int64],
    first_lane: int,
    n_taxels: int,
    n_windows: int,
) -> NDArray[np.float64]:
    """Spikes in each window, float64 (2·n_taxels, n_windows).

    ``window_of``: int64 (n_samples,), ascending window of each sample; later ones are dropped.
    """
    out = np.zeros((2 * n_taxels, n_windows))
    _windows_compiled(counts, len(window_of), first_lane, n_taxels, window_of, out)
    return out
