"""What a trial's samples are, in few bytes: their range, and a hash by which they are known again.

The hash is XXH64, as its specification gives it: memory is read faster than it is written, and
nobody forges recordings to deceive a cache.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

P1, P2, P3, P4, P5 = (
    np.uint64(prime)
    for prime in (
        0x9E3779B185EBCA87,
        0xC2B2AE3D27D4EB4F,
        0x165667B19E3779F9,
        0x85EBCA77C2B2AE63,
        0x27D4EB2F165667C5,
    )
)
LANES = 32
"""Rows whose readings are compared side by side, so that any number of taxels fills a vector."""


def hash_of(data: NDArray[Any]) -> int:
    """XXH64 with seed 0 of an array's bytes."""
    octets = np.ascontiguousarray(data).reshape(-1).view(np.uint8)
    words = np.frombuffer(octets[: len(octets) // 8 * 8].tobytes(), np.uint64)
    return int(_hash_compiled(words, octets[len(words) * 8 :]))


def look_at(
    memory: NDArray[np.uint16], begins: NDArray[np.int64], lengths: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], NDArray[np.uint16], NDArray[np.uint16]]:
    """Hash, lowest and highest readings of trials: uint64 (n,), twice uint16 (n, n_taxels).

    Each trial is ``lengths`` rows, at least one, of the contiguous ``memory`` (rows, n_taxels)
    from ``begins`` on, which is at a multiple of 8 bytes.
    """
    n, width = len(lengths), memory.shape[1]
    hashes = np.empty(n, np.uint64)
    low, high = (np.empty((n, width), np.uint16) for _ in range(2))
    _look_compiled(memory.reshape(-1), begins * width, lengths * width, hashes, low, high)
    return hashes, low, high


def _look(flat: Any, begins: Any, lengths: Any, hashes: Any, low: Any, high: Any) -> None:
    for i in range(len(lengths)):
        samples = flat[begins[i] : begins[i] + lengths[i]]
        _range_compiled(samples, low.shape[1], low[i], high[i])
        whole = len(samples) // 4 * 4
        words = samples[:whole].view(np.uint64)
        hashes[i] = _hash_compiled(words, samples[whole:].view(np.uint8))


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


def _hash(words: Any, rest: Any) -> Any:
    """XXH64 of whole words and up to 7 octets behind them."""
    n, total = len(words), np.uint64(8 * len(words) + len(rest))
    at, found = 0, P5
    if n >= 4:
        a, b = P1 + P2, P2
        c, d = np.uint64(0), np.uint64(0) - P1
        while at + 4 <= n:
            a = _round(a, words[at])
            b = _round(b, words[at + 1])
            c = _round(c, words[at + 2])
            d = _round(d, words[at + 3])
            at += 4
        found = _turned(a, 1) + _turned(b, 7) + _turned(c, 12) + _turned(d, 18)
        for lane in (a, b, c, d):
            found = (found ^ _round(np.uint64(0), lane)) * P1 + P4
    found += total
    for i in range(at, n):
        found = _turned(found ^ _round(np.uint64(0), words[i]), 27) * P1 + P4
    first = 0
    if len(rest) >= 4:
        word = np.uint64(0)
        for i in range(4):
            word |= np.uint64(rest[i]) << np.uint64(8 * i)
        found = _turned(found ^ (word * P1), 23) * P2 + P3
        first = 4
    for i in range(first, len(rest)):
        found = _turned(found ^ (np.uint64(rest[i]) * P5), 11) * P1
    found = (found ^ (found >> np.uint64(33))) * P2
    found = (found ^ (found >> np.uint64(29))) * P3
    return found ^ (found >> np.uint64(32))


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")


@_compile
def _turned(x: Any, bits: Any) -> Any:
    """Bits turned to the left."""
    return (x << np.uint64(bits)) | (x >> np.uint64(64 - bits))


@_compile
def _round(lane: Any, word: Any) -> Any:
    """One word into one of the four sums."""
    return _turned(lane + word * P2, 31) * P1


_range_compiled = _compile(_range)
_hash_compiled = _compile(_hash)
_look_compiled = _compile(_look)
