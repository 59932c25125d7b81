"""Fingerprints of trials: the range of their samples, and a hash that identifies them.

The hash is XXH3, which is faster than the memory that it reads; a cache of recordings needs no
protection against forgery.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from xxhash import xxh3_64_intdigest

Samples = NDArray[np.uint16]

LANES = 32
"""Rows that NumPy compares side by side: single rows are too short for vector instructions."""


def hash_array(data: NDArray[Any]) -> int:
    """Return the XXH3 (64 bits, seed 0) of an array's bytes."""
    return xxh3_64_intdigest(np.ascontiguousarray(data).data)


def fingerprint(
    samples: Samples, starts: NDArray[np.int64], lengths: NDArray[np.int64]
) -> tuple[NDArray[np.uint64], Samples, Samples]:
    """Return hash, minimum and maximum of trials: uint64 (n,), uint16 (n, n_taxels) each.

    Each trial is ``lengths`` rows, at least one, of the contiguous ``samples`` (rows, n_taxels),
    from row ``starts`` on.
    """
    trials = [samples[start : start + n] for start, n in zip(starts, lengths, strict=True)]
    hashes = np.array([hash_array(trial) for trial in trials], np.uint64)
    low, high = (
        np.array([_reduce_rows(extreme, trial) for trial in trials])
        for extreme in (np.minimum, np.maximum)
    )
    return hashes, low, high


def _reduce_rows(extreme: np.ufunc, trial: Samples) -> Samples:
    """Return the minimum or maximum of each column, uint16 (n_taxels,)."""
    width = trial.shape[1]
    n = len(trial) // LANES * LANES
    wide = trial[:n].reshape(-1, LANES * width)
    folded = extreme.reduce(wide).reshape(LANES, width) if n else trial[:0]
    extremes: Samples = extreme.reduce(np.concatenate([folded, trial[n:]]))
    return extremes
