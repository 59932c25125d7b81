"""Benchmark the drum controller's firmware on its simulated chip; the same on any machine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tests.benchmarks.firmware._drum_safety import safety
from tests.benchmarks.firmware._drum_timing import timing
from tests.benchmarks.firmware._drum_wire import wire


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.*``."""
    yield from timing()
    yield from safety()
    yield from wire()
