"""Per-sample spike counts of many lanes: laid side by side, turned into trains, counted in windows.

A raster is uint8 (n, 2·lanes): SA of every lane, then RA of every lane. Trials share a raster side
by side; one that is shorter than the raster ends early, and what follows is filling.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from rigctl.values import Spikes

WORD = 8
NONE, ONE, BYTE, SHIFT = np.uint64(0), np.uint64(1), np.uint64(0xFF), np.uint64(58)
DE_BRUIJN = np.uint64(0x03F79D71B4CB0A89)
BYTE_OF = np.zeros(64, np.uint8)
for _bit in range(64):
    BYTE_OF[((int(DE_BRUIJN) << _bit) & (2**64 - 1)) >> int(SHIFT)] = _bit // WORD


def _copy_beside(samples: Any, tile: Any, first: Any) -> None:
    """Copy a trial (n, k) into the tile's columns from ``first``; its last row fills the rest."""
    n, k = samples.shape
    for t in range(tile.shape[0]):
        row = samples[min(t, n - 1)]
        for j in range(k):
            tile[t, first + j] = row[j]


def _collect(words: Any, flat: Any, lengths: Any, places: Any, row_start: Any) -> Any:
    """Gather the columns and samples that hold spikes; return how many there are.

    ``places`` int32 (m, 2) takes (column, sample); ``row_start`` int64 (columns + 1,), zeros
    before, becomes the running sum of spikes. Within a word only bytes that are not 0 are visited:
    the lowest set bit's place comes from a de Bruijn product.
    """
    columns = lengths.shape[0]
    t, column, found = 0, 0, 0
    for w in range(words.shape[0]):
        word = words[w]
        while word != NONE:
            lowest = word & (~word + ONE)
            byte = np.int64(BYTE_OF[np.int64((lowest * DE_BRUIJN) >> SHIFT)])
            word = word & ~(BYTE << np.uint64(WORD * byte))
            at_t, at_column = t, column + byte
            while at_column >= columns:
                at_t, at_column = at_t + 1, at_column - columns
            if at_t < lengths[at_column]:
                places[found, 0], places[found, 1] = at_column, at_t
                row_start[1 + at_column] += flat[WORD * w + byte]
                found += 1
        column += WORD
        while column >= columns:
            t, column = t + 1, column - columns
    for i in range(columns):
        row_start[i + 1] += row_start[i]
    return found


def _distribute(places: Any, counts: Any, at: Any, sample_index: Any) -> None:
    """Write every spike's sample; ``at`` int64 (columns,) holds the next free places."""
    for i in range(places.shape[0]):
        column, t = places[i, 0], places[i, 1]
        for _ in range(counts[t, column]):
            sample_index[at[column]] = t
            at[column] += 1


def _windows(counts: Any, first: Any, n_taxels: Any, window_of: Any, out: Any) -> None:
    """Add each sample's spikes to its window: out float64 (n_windows, 2·n_taxels)."""
    half = counts.shape[1] // 2
    sums = np.zeros(2 * n_taxels, np.int64)
    n = window_of.shape[0]
    for t in range(n):
        window = window_of[t]
        if window >= out.shape[0]:
            break
        for j in range(n_taxels):
            sums[j] += counts[t, first + j]
        for j in range(n_taxels):
            sums[n_taxels + j] += counts[t, half + first + j]
        if t + 1 == n or window_of[t + 1] != window:
            for j in range(2 * n_taxels):
                out[window, j] = sums[j]
                sums[j] = 0


_compile = numba.njit(cache=True, nogil=True)
_copy_compiled = _compile(_copy_beside)
_collect_compiled = _compile(_collect)
_distribute_compiled = _compile(_distribute)
_windows_compiled = _compile(_windows)


def lay_side_by_side(trials: Sequence[NDArray[np.uint16]], tile: NDArray[np.uint16]) -> None:
    """Fill a tile, uint16 (longest, trials · n_taxels); a shorter trial holds its last reading."""
    n_taxels = trials[0].shape[1]
    for place, samples in enumerate(trials):
        if len(samples):
            contiguous = np.ascontiguousarray(samples, dtype=np.uint16)
            _copy_compiled(contiguous, tile, place * n_taxels)
        else:
            tile[:, place * n_taxels : (place + 1) * n_taxels] = 0


def to_spikes(counts: NDArray[np.uint8], n_samples: Sequence[int], n_taxels: int) -> list[Spikes]:
    """Trains of all trials in a raster; ``n_samples`` of each, in their order side by side."""
    lengths = np.tile(np.repeat(np.asarray(n_samples, np.int64), n_taxels), 2)
    # Spikes are few: eight counts at a time are looked at, and passed over where all are 0.
    flat = np.zeros(-(-counts.size // WORD) * WORD, np.uint8)
    flat[: counts.size] = counts.reshape(-1)
    places = np.empty((np.count_nonzero(flat), 2), np.int32)
    row_start = np.zeros(len(lengths) + 1, np.int64)
    found = _collect_compiled(flat.view(np.uint64), flat, lengths, places, row_start)
    sample_index = np.empty(row_start[-1], np.int32)
    _distribute_compiled(places[:found], counts, row_start[:-1].copy(), sample_index)
    half = len(lengths) // 2
    return [
        _of_trial(row_start, sample_index, (first, half + first), n_taxels, n)
        for first, n in zip(range(0, half, n_taxels), n_samples, strict=True)
    ]


def _of_trial(
    row_start: NDArray[np.int64],
    sample_index: NDArray[np.int32],
    firsts: tuple[int, int],
    n_taxels: int,
    n_samples: int,
) -> Spikes:
    """One trial's SA and RA columns as trains of its own."""
    ends = [row_start[first : first + n_taxels + 1] for first in firsts]
    indices = np.concatenate([sample_index[end[0] : end[-1]] for end in ends])
    sa, ra = (end - end[0] for end in ends)
    return Spikes(np.concatenate([sa, sa[-1] + ra[1:]]), indices, n_samples)


def window_counts(
    counts: NDArray[np.uint8],
    window_of: NDArray[np.int64],
    first_lane: int,
    n_taxels: int,
    n_windows: int,
) -> NDArray[np.float64]:
    """Spikes in each window of one trial in a raster, float64 (2·n_taxels, n_windows).

    ``window_of``: int64 (n_samples,), ascending window of each sample; later ones are dropped.
    """
    out = np.zeros((n_windows, 2 * n_taxels))
    _windows_compiled(counts, first_lane, n_taxels, window_of, out)
    return np.ascontiguousarray(out.T)
