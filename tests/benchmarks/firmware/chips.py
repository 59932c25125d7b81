"""Benchmark both images with the simulated bench against real time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from rigctl.bench.chips.rig import open_chip_simulation
from rigctl.bench.parameters import WorldParameters
from tests.bench.host import BOOT_US, Host
from tests.firmware.building import built

SECONDS = 20


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``world.firmware_factor``."""
    built("sim/libchips.so")
    images = built("firmware/drum.elf"), built("firmware/taxels.elf")
    simulation = open_chip_simulation(WorldParameters(), 1, *images)
    host = Host(simulation)
    host.wait(BOOT_US)
    host.attend(1_000_000)
    began_s = time.perf_counter()
    host.attend(SECONDS * 1_000_000)
    factor = SECONDS / (time.perf_counter() - began_s)
    simulation.close()
    yield {
        "name": "world.firmware_factor",
        "value": round(factor, 2),
        "unit": "× real time",
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"{SECONDS} s of world: both chips, world, 50 Hz polls, frames decoded, one core",
    }
