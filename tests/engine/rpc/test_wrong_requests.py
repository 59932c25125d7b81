"""Thousands of wrong requests: the engine answers, the drum holds its force, the run goes on."""

from __future__ import annotations

import pytest

from rigctl.bench.simulated_rig import FaultInjection
from rigctl.boards.drum_states import State
from rigctl.engine.drum_commands import DrumCommands
from tests.engine.engine_harness import EngineHarness
from tests.engine.rpc.wrong_requests import Attacker, declared, wrong_requests

LONG = """
name = "long"
textures = ["A"]
speeds_mm_s = [100]
forces_g = [500]
repeats = 500
"""


def lines() -> list[bytes]:
    return list(wrong_requests(*declared(DrumCommands, FaultInjection)))


def test_an_engine_that_holds_a_force_survives_wrong_requests(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        client = await Attacker.connect(harness.address)
        for command in ("arm", "tare", "home"):
            await client.request(command)
        await client.request("set", force_g=500)
        await client.request("approach")
        await client.attack(lines())
        status = harness.engine.status()
        assert status.state is State.HOLD
        assert status.force_g == pytest.approx(500, rel=0.05)
        await client.close()
        client.require_refusals()
        survived.append(True)

    survived: list[bool] = []
    harness.run(scenario)
    assert survived
    assert harness.texts("fault") == []


def test_a_run_goes_on_under_wrong_requests(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        client = await Attacker.connect(harness.address)
        await harness.until(lambda: harness.engine.status().run.trials_committed > 0)
        before = harness.engine.status().run.trials_committed
        await client.attack(lines())
        await harness.until(lambda: harness.engine.status().run.trials_committed > before)
        assert harness.engine.status().run.state == "running"
        assert harness.texts("fault") == []
        await client.close()
        client.require_refusals()
        survived.append(True)

    survived: list[bool] = []
    harness.run(scenario, harness.request(LONG))
    assert survived


def test_a_command_that_fails_inside_ends_nothing(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mistake of ours in one command is an event, and the force stays."""

    async def scenario(harness: EngineHarness) -> None:
        client = await Attacker.connect(harness.address)
        for command in ("arm", "tare", "home", "approach"):
            await client.request(command)
        monkeypatch.setattr(harness.engine, "add_note", lambda text: 1 // 0)
        with pytest.raises(AssertionError, match="ZeroDivisionError"):
            await client.request("note", text="lost")
        await client.request("status")
        assert harness.engine.status().state is State.HOLD
        await client.close()
        survived.append(True)

    survived: list[bool] = []
    harness.run(scenario)
    assert survived
    (fault,) = harness.texts("fault")
    assert "note failed inside the engine, which goes on" in fault
