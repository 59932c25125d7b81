"""Fingerprints of trials: the range of their samples, and a hash that identifies them.

The hash is XXH3, which is faster than memory is read; a cache of recordings needs no protection
against forgery.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from xxhash import xxh3_64_intdigest

LANES = 32
"""Rows compared side by side, so that any number of taxels fills a vector register."""


def hash_array(data: NDArray[Any]) -> int:
    """Return the XXH3 (64 bits, seed 0) of an array's bytes."""
    return xxh3_64_intdigest(np.ascontiguousarray(data).data)


def fingerprint(
    samples: NDArray[np.uint16], starts: NDArray[np.int64], lengths: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Return hash, minimum and maximum of trials: uint64 (n,), twice uint16 (n, n_taxels).

    Each trial is ``lengths`` rows, at least one, of the contiguous ``samples`` (rows, n_taxels),
    from row ``starts`` on.
    """
    spans = zip(starts.tolist(), lengths.tolist(), strict=True)
    hashes = [hash_array(samples[start : start + n]) for start, n in spans]
    low, high = (np.empty((len(lengths), samples.shape[1]), np.uint16) for _ in range(2))
    _ranges_compiled(samples, starts, lengths, low, high)
    return np.array(hashes, np.uint64), low, high


def _ranges(samples: Any, starts: Any, lengths: Any, low: Any, high: Any) -> None:
    for i in range(len(lengths)):
        trial = samples[starts[i] : starts[i] + lengths[i]]
        _range_compiled(trial.reshape(-1), samples.shape[1], low[i], high[i])


def _range(flat: Any, width: Any, low: Any, high: Any) -> None:
    """Write the minimum and maximum of each of ``width`` columns of the flattened rows."""
    period = width * LANES
    lows, highs = np.empty(period, np.uint16), np.empty(period, np.uint16)
    for j in range(period):
        lows[j] = highs[j] = flat[j % width]
    whole = len(flat) // period * period
    for start in range(0, whole, period):
        block = flat[start : start + period]
        for j in range(period):
            lows[j] = min(lows[j], block[j])
            highs[j] = max(highs[j], block[j])
    for j in range(len(flat) - whole):
        lows[j] = min(lows[j], flat[whole + j])
        highs[j] = max(highs[j], flat[whole + j])
    for j in range(width):
        low[j], high[j] = lows[j], highs[j]
    for j in range(width, period):
        low[j % width] = min(low[j % width], lows[j])
        high[j % width] = max(high[j % width], highs[j])


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_range_compiled = _compile(_range)
_ranges_compiled = _compile(_ranges)
