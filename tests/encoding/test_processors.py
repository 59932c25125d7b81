"""What is equal to the bit on one processor is so on others, with their own vectors and libraries.

A subprocess compiles and dispatches as on a processor with AVX2 alone, and as on one with AVX-512.
Each has a cache of its own: numba's does not distinguish processors well enough.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from tests.encoding.other_registers import digest

TESTS = (
    "tests/encoding/test_encoder.py",
    "tests/encoding/test_scaled_time.py",
    "tests/simulation/finger/test_virtual_finger.py",
)
"""Their tests with the mark compare to the bit what was computed in two ways."""
CACHES = Path(__file__).parents[2] / "build" / "numba"
HASWELL = (
    "64bit adx aes avx avx2 bmi bmi2 cmov crc32 cx16 cx8 f16c fma fsgsbase fxsr lzcnt mmx movbe "
    "pclmul popcnt rdrnd rdseed sahf sse sse2 sse3 sse4.1 sse4.2 ssse3 xsave xsaveopt"
)
AVX512 = "avx512f avx512bw avx512cd avx512dq avx512vl"
PROCESSORS = {
    "AVX2": ("haswell", HASWELL, "Haswell"),
    "AVX-512": ("skylake-avx512", f"{HASWELL} {AVX512}", "SkylakeX"),
}


@pytest.fixture(params=PROCESSORS)
def processor(request: pytest.FixtureRequest) -> dict[str, str]:
    """Return the environment of a program as on another processor."""
    name, features, blas = PROCESSORS[request.param]
    here = llvmlite.binding.get_host_cpu_features()
    if not all(here.get(feature) for feature in features.split()):
        pytest.skip(f"not run: this processor has no {request.param}")
    wide = [f for f in __cpu_dispatch__ if f.startswith(("AVX512", "X86_V4"))]
    hidden = [f for f in wide if __cpu_features__[f]] if request.param == "AVX2" else []
    return {
        **os.environ,
        "NUMBA_CPU_NAME": name,
        "NUMBA_CPU_FEATURES": ",".join(f"+{feature}" for feature in features.split()),
        "NUMBA_CACHE_DIR": str(CACHES / name),
        "NPY_DISABLE_CPU_FEATURES": " ".join(hidden),
        "OPENBLAS_CORETYPE": blas,
    }


def test_the_comparisons_to_the_bit_hold_on_another_processor(processor: dict[str, str]) -> None:
    options = ["-q", "-p", "no:cacheprovider", "-m", "to_the_bit"]
    command = [sys.executable, "-m", "pytest", *options, *TESTS]
    done = subprocess.run(command, env=processor, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_another_processor_gives_the_same_spikes(processor: dict[str, str]) -> None:
    command = [sys.executable, "-m", "tests.encoding.other_registers"]
    ran = subprocess.run(command, env=processor, capture_output=True, text=True, check=True)
    assert ran.stdout.split()[1] == digest()
