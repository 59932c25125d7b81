"""Benchmark the virtual rig's recording against real time, with every part of a run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rigctl.config.resources import find_protocol
from tests.acquisition.engine_harness import open_harness

SEED = 1
ROUNDS = 3


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``world.virtual_factor``: simulated time over wall time, the best of three runs."""
    factors = [recorded_factor() for _ in range(ROUNDS)]
    yield {
        "name": "world.virtual_factor",
        "value": round(max(factors), 1),
        "unit": "× real time",
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"quick.toml in one process: world, virtual boards, drivers, polls, live encoder, "
        f"recorder with fsync; best of {ROUNDS}, slowest {min(factors):.1f}",
    }


def recorded_factor() -> float:
    """Return simulated seconds per wall second while the quick protocol is recorded."""
    text = find_protocol("quick").read_text()
    with tempfile.TemporaryDirectory() as folder, open_harness(Path(folder), SEED) as harness:
        began_s = time.perf_counter()
        harness.record(text)
        return harness.rig.loop.time() / (time.perf_counter() - began_s)
