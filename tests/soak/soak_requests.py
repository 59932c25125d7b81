"""Mutated requests to running engines. ``make fuzz`` runs it; it is not part of the suite."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from pathlib import Path
from random import Random
from typing import Any

from rigctl.bench.simulated_rig import FaultInjection
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.engine_commands import EngineCommands
from rigctl.finger.bench.virtual import FingerFaults
from rigctl.finger.commands import FingerCommands
from tests.engine.engine_harness import EngineHarness, open_harness
from tests.engine.rpc.wrong_requests import Attacker, declared, mutated, wrong_requests
from tests.finger.harness import FingerHarness, open_finger_harness

REQUESTS = 100_000
ENDING = ("stop", "abort", "pause", "shutdown", "start")
"""Commands that a mutation could make right, and that end or hold a run as they should."""
LONG = """
name = "long"
textures = ["A"]
speeds_mm_s = [100]
forces_g = [500]
repeats = 100000
"""
MANY_SCANS = """
name = "many-scans"
textures = ["A", "D", "L"]
profiles = ["medium", "fast"]

[stages]
normalise = 1000
train = 0
calibrate = 0
run = 0
"""


def lines(handler: type[EngineCommands[Any]], faults: type) -> list[bytes]:
    """Return short wrong requests of commands that leave a run alone."""
    commands, _ = declared(handler, faults)
    kept = {name: names for name, names in commands.items() if name not in ENDING}
    return [line for line in wrong_requests(kept, {}) if len(line) < 2000]


async def attack(address: tuple[str, int], wrong: list[bytes], committed: Callable[[], int]) -> int:
    """Send the requests; return how many trials were committed meanwhile."""
    client, before = await Attacker.connect(address), committed()
    await client.attack(islice(mutated(wrong, Random(18)), REQUESTS))
    await client.close()
    client.require_refusals()
    return committed() - before


def test_the_drums_engine_goes_on_under_mutated_requests(tmp_path: Path) -> None:
    async def scenario(harness: EngineHarness) -> None:
        wrong, engine = lines(DrumCommands, FaultInjection), harness.engine
        await harness.until(lambda: engine.status().run.trials_committed > 0)
        grown = await attack(harness.address, wrong, lambda: engine.status().run.trials_committed)
        assert engine.status().run.state == "running"
        committed.append(grown)

    committed: list[int] = []
    with open_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(LONG))
        assert committed[0] > 0
        assert harness.texts("fault") == []


def test_the_fingers_engine_goes_on_under_mutated_requests(tmp_path: Path) -> None:
    async def scenario(harness: FingerHarness) -> None:
        wrong, engine = lines(FingerCommands, FingerFaults), harness.engine
        await harness.until_scanning()
        grown = await attack(harness.address, wrong, lambda: engine.status().run.trials_committed)
        assert engine.status().run.state == "running"
        committed.append(grown)

    committed: list[int] = []
    with open_finger_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(protocol=MANY_SCANS))
        assert committed[0] > 0
        assert harness.texts("fault") == []
