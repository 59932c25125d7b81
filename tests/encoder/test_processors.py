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

import pytest

from rigctl.encoder.kernel.simd import VECTOR_WIDTH
from tests.encoder.other_registers import digest
from tests.encoder.processors import CACHES, haswell_environment

TESTS = (
    "tests/encoder/test_encoder.py",
    "tests/finger/test_scaled_time.py",
    "tests/finger/bench/test_virtual.py",
)
"""Their tests with the mark compare to the bit what was computed in two ways."""


@pytest.fixture
def haswell() -> dict[str, str]:
    """Return the environment of a program as on a processor with AVX2 and without AVX-512."""
    environment = haswell_environment()
    if environment is None:
        pytest.skip("not run: this processor has no AVX2")
    return environment


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
