"""Encode as on a processor with other registers: prints a digest of spikes and membranes.

With the argument ``other`` numba reports registers of 512 bits if the host has none, and none if it
has some, while the kernel defines its vectors; LLVM then splits or joins them. Needs its own
``NUMBA_CACHE_DIR``: numba's cache does not distinguish the two layouts.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numba
import numpy as np
from numba.core import codegen
from numba.core.registry import cpu_target


@contextmanager
def avx512_inverted() -> Iterator[None]:
    """Report the features that numba compiles for with AVX-512 inverted."""
    _ = cpu_target.target_context  # numba reads the true features once, here
    config: Any = numba.config
    host: Any = codegen
    configured = config.CPU_FEATURES
    features = host.get_host_cpu_features() if configured is None else configured
    inverted = "-avx512f" if "+avx512f" in features.split(",") else "+avx512f"
    config.CPU_FEATURES = f"{features.replace('avx512f', 'other')},{inverted}"
    try:
        yield
    finally:
        config.CPU_FEATURES = configured


def digest() -> str:
    """Return a digest of trains, counts and membranes of schemes with different orders."""
    from rigctl.encoder.batch import count_spikes_without_and_with_c
    from rigctl.encoder.encoder import encode_trials, membrane_mv
    from rigctl.encoder.normalisation import Normalisation
    from rigctl.encoder.parameters import DEFAULT, PRESETS

    rng, ranges = np.random.default_rng(0), Normalisation.full_scale(5)
    lengths = rng.integers(1, 700, 21)
    trials = [rng.integers(0, 1024, (n, 5)).astype(np.uint16) for n in lengths]
    scale, edges = rng.uniform(0.5, 2, (len(trials), 5)), np.array([0, 100, 700])
    result = hashlib.sha256()
    schemes = (replace(DEFAULT, sa_gain=3000.0), *PRESETS.values())
    for scheme in schemes:
        for spikes in encode_trials(trials, ranges, scheme, sa_scale=scale):
            result.update(spikes.row_start.tobytes() + spikes.sample_index.tobytes())
    for scheme in (DEFAULT, PRESETS["iskarous2022"]):
        for counts in count_spikes_without_and_with_c(trials, edges, ranges, scheme, scale):
            result.update(counts.tobytes())
        result.update(membrane_mv(trials[-1], ranges, scheme).tobytes())
    return result.hexdigest()


if __name__ == "__main__":
    if "NUMBA_CACHE_DIR" not in os.environ:
        raise SystemExit(
            "set NUMBA_CACHE_DIR to an empty folder: numba does not distinguish the two layouts"
        )
    if sys.argv[1:] == ["other"]:
        with avx512_inverted():
            from rigctl.encoder.kernel import simd
    else:
        from rigctl.encoder.kernel import simd
    print(simd.VECTOR_WIDTH, digest())
