"""Encode as on a processor with other registers: prints a digest of spikes and membranes.

With the argument ``other`` the host's word on registers of 512 bits is taken for its contrary while
the kernel's vectors are laid out; LLVM then makes them of what registers there are. Needs a
``NUMBA_CACHE_DIR`` of its own: numba's cache takes both layouts for one.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numba.core import codegen
from numba.core.registry import cpu_target


@contextmanager
def turned_about() -> Iterator[None]:
    """The host's features as they are, but for AVX-512."""
    _ = cpu_target.target_context  # numba asks once, and is told the truth
    real: Any = codegen.get_host_cpu_features
    features = real()
    told = "-avx512f" if "+avx512f" in features.split(",") else "+avx512f"
    codegen.get_host_cpu_features = lambda: f"{features.replace('avx512f', 'other')},{told}"
    try:
        yield
    finally:
        codegen.get_host_cpu_features = real


def digest() -> str:
    """Of trains, counts and membranes by schemes that keep to different orders."""
    from rigctl.encoding.batch import count_spikes_without_and_with_c
    from rigctl.encoding.encoder import encode_trials, membrane_mv
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.encoding.parameters import DEFAULT, PRESETS

    rng, ranges = np.random.default_rng(0), Normalisation.full_scale(5)
    lengths = rng.integers(1, 700, 21)
    trials = [rng.integers(0, 1024, (n, 5)).astype(np.uint16) for n in lengths]
    scale, cuts = rng.uniform(0.5, 2, (len(trials), 5)), np.array([0, 100, 700])
    found = hashlib.sha256()
    schemes = (replace(DEFAULT, sa_gain=3000.0), *PRESETS.values())
    for scheme in schemes:
        for spikes in encode_trials(trials, ranges, scheme, sa_scale=scale):
            found.update(spikes.row_start.tobytes() + spikes.sample_index.tobytes())
    for scheme in (DEFAULT, PRESETS["iskarous2022"]):
        for counts in count_spikes_without_and_with_c(trials, cuts, ranges, scheme, scale):
            found.update(counts.tobytes())
        found.update(membrane_mv(trials[-1], ranges, scheme).tobytes())
    return found.hexdigest()


if __name__ == "__main__":
    if "NUMBA_CACHE_DIR" not in os.environ:
        raise SystemExit("set NUMBA_CACHE_DIR to an empty folder: numba takes both layouts for one")
    if sys.argv[1:] == ["other"]:
        with turned_about():
            from rigctl.encoding.kernel import simd
    else:
        from rigctl.encoding.kernel import simd
    print(simd.VECTOR_WIDTH, digest())
