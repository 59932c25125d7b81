"""Encode as on a processor with other registers: prints a digest of spikes and membranes.

With the argument ``other`` the host's word on registers of 512 bits is taken for its contrary while
the kernel's vectors are laid out; LLVM then makes them of what registers there are.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from llvmlite import binding
from numba.core.registry import cpu_target


@contextmanager
def turned_about() -> Iterator[None]:
    """The host's features as they are, but for AVX-512."""
    real = binding.get_host_cpu_features
    _ = cpu_target.target_context  # numba asks once, and is told the truth
    features = dict(real())
    features["avx512f"] = not features.get("avx512f", False)
    binding.get_host_cpu_features = lambda: features
    try:
        yield
    finally:
        binding.get_host_cpu_features = real


def digest() -> str:
    """Of trains, counts and membranes by two schemes that keep to different orders."""
    from rigctl.encoding.bulk import counts_without_and_with
    from rigctl.encoding.encoder import encode_trials, membrane_mv
    from rigctl.encoding.normalisation import Normalisation
    from rigctl.encoding.presets import DEFAULT, PRESETS

    rng, ranges = np.random.default_rng(0), Normalisation.full_scale(5)
    trials = [rng.integers(0, 1024, (n, 5)).astype(np.uint16) for n in (1, 63, 200, 333, 700)]
    scale, cuts, found = rng.uniform(0.5, 2, (5, 5)), np.array([0, 100, 700]), hashlib.sha256()
    for scheme in (DEFAULT, replace(DEFAULT, sa_gain=3000.0), PRESETS["iskarous2022"]):
        for spikes in encode_trials(trials, ranges, scheme, sa_scale=scale):
            found.update(spikes.row_start.tobytes() + spikes.sample_index.tobytes())
        for counts in counts_without_and_with(trials, cuts, ranges, scheme, scale):
            found.update(counts.tobytes())
        found.update(membrane_mv(trials[-1], ranges, scheme).tobytes())
    return found.hexdigest()


if __name__ == "__main__":
    if sys.argv[1:] == ["other"]:
        with turned_about():
            from rigctl.encoding import lanes
    else:
        from rigctl.encoding import lanes
    print(lanes.WIDE, digest())
