"""Benchmark the simulated worlds against real time."""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rigctl.bench.clock import SimulatedTimeLoop
from rigctl.config.resources import find_protocol
from rigctl.finger import board_messages
from rigctl.finger.bench.virtual import open_virtual_finger
from rigctl.finger.values import TEXTURES, VelocityProfile
from tests.engine.engine_harness import open_harness

SEED = 1
ROUNDS = 3
VELOCITY_S = 0.1
IDLE_S = 1.0


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``world.*_factor``: simulated time over wall time, the best of three runs."""
    yield _virtual_rig()
    yield _virtual_finger()


def _virtual_rig() -> dict[str, Any]:
    factors = [recorded_factor() for _ in range(ROUNDS)]
    return {
        "name": "world.virtual_factor",
        "value": round(max(factors), 1),
        "unit": "× real time",
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"quick.toml in one process: world, virtual boards, drivers, polls, live encoder, "
        f"recorder with fsync; best of {ROUNDS}, slowest {min(factors):.1f}",
    }


def _virtual_finger() -> dict[str, Any]:
    factors = [finger_factor() for _ in range(ROUNDS)]
    return {
        "name": "world.finger_factor",
        "value": round(max(factors), 1),
        "unit": "× real time",
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": f"25 slides, free-running event loop: person, skin, tracker, firmware, a velocity "
        f"every 100 ms, bytes not decoded; best of {ROUNDS}, slowest {min(factors):.1f}",
    }


def finger_factor() -> float:
    """Return simulated seconds per wall second of the virtual finger, every profile and plate."""
    rig = open_virtual_finger(seed=SEED)
    rig.finger.open(lambda data, at_s: None, lambda reason: None)
    rig.tracker.open(lambda position: None, lambda reason: None)

    async def slide(texture: str, profile: VelocityProfile) -> None:
        scan, batch = rig.next_slide, 0
        rig.slide(texture, profile)
        rig.finger.write(board_messages.start(scan))
        while rig.sliding:
            await asyncio.sleep(VELOCITY_S)
            rig.finger.write(board_messages.velocity(scan, batch, 100_000))
            batch += 1
        rig.finger.write(board_messages.stop(scan))
        await asyncio.sleep(IDLE_S)

    loop = SimulatedTimeLoop(rig)
    loop.run_until_complete(slide("A", VelocityProfile.FAST))  # loads the kernels
    began_s, began = time.perf_counter(), loop.time()
    for profile in VelocityProfile:
        for texture in TEXTURES:
            loop.run_until_complete(slide(texture, profile))
    factor = (loop.time() - began) / (time.perf_counter() - began_s)
    loop.close()
    rig.close()
    return factor


def recorded_factor() -> float:
    """Return simulated seconds per wall second while the quick protocol is recorded."""
    text = find_protocol("quick").read_text()
    with tempfile.TemporaryDirectory() as folder, open_harness(Path(folder), SEED) as harness:
        began_s = time.perf_counter()
        harness.record(text)
        return harness.rig.loop.time() / (time.perf_counter() - began_s)
