"""What a trial's samples are, in few bytes: their range, and a hash by which they are known again.

The hash is XXH3, which is faster than memory is read; nobody forges recordings to deceive a cache.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from xxhash import xxh3_64_intdigest

LANES = 32
"""Rows whose readings are compared side by side, so that any number of taxels fills a vector."""


def hash_of(data: NDArray[Any]) -> int:
    """XXH3 of 64 bits, with seed 0, of an array's bytes."""
    return xxh3_64_intdigest(np.ascontiguousarray(data).data)


def look_at(
    memory: NDArray[np.uint16], begins: NDArray[np.int64], lengths: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Hash, lowest and highest readings of trials: uint64 (n,), twice uint16 (n, n_taxels).

    Each trial is ``lengths`` rows, at least one, of the contiguous ``memory`` (rows, n_taxels)
    from ``begins`` on.
    """
    spans = zip(begins.tolist(), lengths.tolist(), strict=True)
    hashes = [hash_of(memory[begin : begin + n]) for begin, n in spans]
    low, high = (np.empty((len(lengths), memory.shape[1]), np.uint16) for _ in range(2))
    _ranges_compiled(memory, begins, lengths, low, high)
    return np.array(hashes, np.uint64), low, high


def _ranges(memory: Any, begins: Any, lengths: Any, low: Any, high: Any) -> None:
    for i in range(len(lengths)):
        samples = memory[begins[i] : begins[i] + lengths[i]]
        _range_compiled(samples.reshape(-1), memory.shape[1], low[i], high[i])


def _range(flat: Any, width: Any, low: Any, high: Any) -> None:
    """Lowest and highest of each column of rows that lie one behind the other."""
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
