"""The environment in which numba, NumPy and OpenBLAS work as on a processor with AVX2 alone."""

from __future__ import annotations

import os
from pathlib import Path

import llvmlite.binding
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

CACHES = Path(__file__).parents[2] / "build" / "numba"
HASWELL = (
    "64bit adx aes avx avx2 bmi bmi2 cmov crc32 cx16 cx8 f16c fma fsgsbase fxsr lzcnt mmx movbe "
    "pclmul popcnt rdrnd rdseed sahf sse sse2 sse3 sse4.1 sse4.2 ssse3 xsave xsaveopt"
)


def haswell_environment() -> dict[str, str] | None:
    """Return that of AVX2 without AVX-512; None where this processor has no AVX2."""
    here = llvmlite.binding.get_host_cpu_features()
    if not all(here.get(feature) for feature in HASWELL.split()):
        return None
    wide = [f for f in __cpu_dispatch__ if f.startswith(("AVX512", "X86_V4"))]
    return {
        **os.environ,
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": ",".join(f"+{feature}" for feature in HASWELL.split()),
        "NUMBA_CACHE_DIR": str(CACHES / "haswell"),
        "NPY_DISABLE_CPU_FEATURES": " ".join(f for f in wide if __cpu_features__[f]),
        "OPENBLAS_CORETYPE": "Haswell",
    }
