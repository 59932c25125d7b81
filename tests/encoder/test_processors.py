"""What is equal to the bit on one processor is so on others, with their own vectors and libraries.

A subprocess compiles and dispatches as on a processor with AVX2 alone, or with the kernel's vectors
for registers that this processor may not have. Where the processor has AVX-512, the suite's own
process is that case. Each has a cache of its own: numba's does not distinguish processors well
enough.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

from rigctl.encoder.kernel.simd import VECTOR_WIDTH
from tests.encoder.other_registers import digest

TESTS = (
    "tests/encoder/test_encoder.py",
    "tests/finger/test_scaled_time.py",
    "tests/finger/bench/test_virtual.py",
)
"""Their tests with the mark compare to the bit what was computed in two ways."""
CACHES = Path(__file__).parents[2] / "build" / "numba"
HASWELL = (
    "64bit adx aes avx avx2 bmi bmi2 cmov crc32 cx16 cx8 f16c fma fsgsbase fxsr lzcnt mmx movbe "
    "pclmul popcnt rdrnd rdseed sahf sse sse2 sse3 sse4.1 sse4.2 ssse3 xsave xsaveopt"
)


@pytest.fixture
def haswell() -> dict[str, str]:
    """Return the environment of a program as on a processor with AVX2 and without AVX-512."""
    here = llvmlite.binding.get_host_cpu_features()
    if not all(here.get(feature) for feature in HASWELL.split()):
        pytest.skip("not run: this processor has no AVX2")
    wide = [f for f in __cpu_dispatch__ if f.startswith(("AVX512", "X86_V4"))]
    return {
        **os.environ,
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": ",".join(f"+{feature}" for feature in HASWELL.split()),
        "NUMBA_CACHE_DIR": str(CACHES / "haswell"),
        "NPY_DISABLE_CPU_FEATURES": " ".join(f for f in wide if __cpu_features__[f]),
        "OPENBLAS_CORETYPE": "Haswell",
    }


def encoded(environment: dict[str, str], *which: str) -> list[str]:
    """Return the width of the vectors and the digest of the spikes in another process."""
    command = [sys.executable, "-m", "tests.encoder.other_registers", *which]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return ran.stdout.split()


def test_the_comparisons_to_the_bit_hold_on_another_processor(haswell: dict[str, str]) -> None:
    options = ["-q", "-p", "no:cacheprovider", "-m", "to_the_bit"]
    command = [sys.executable, "-m", "pytest", *options, *TESTS]
    done = subprocess.run(command, env=haswell, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_another_processor_gives_the_same_spikes(haswell: dict[str, str]) -> None:
    assert encoded(haswell) == ["4", digest()]


def test_other_registers_give_the_same_spikes() -> None:
    width, spikes = encoded({**os.environ, "NUMBA_CACHE_DIR": str(CACHES / "other")}, "other")
    assert {int(width), VECTOR_WIDTH} == {4, 8}
    assert spikes == digest()
