"""What clients may ask of an engine, and what it answers."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import numpy as np
import pytest

from rigctl.acquisition.protocol.run_control import RunControl
from rigctl.acquisition.rpc.command_handler import CommandHandler
from rigctl.acquisition.rpc.messages import CurrentTrial, RunStatus
from rigctl.errors import CommandRefused, WrongUse
from rigctl.wire.drum import register_table
from rigctl.wire.drum.states import State
from tests.acquisition.engine_harness import EngineHarness, until_ended


def asked(harness: EngineHarness) -> Any:
    """The desk of the harness's engine."""
    return CommandHandler(harness.engine).handle


def state_of(harness: EngineHarness) -> State:
    return State(harness.engine.status().state)


def test_a_person_drives_the_drum_step_by_step(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        assert harness.engine.status().run == RunStatus()
        await ask("arm", {})
        assert state_of(harness) is State.ARMED
        await ask("tare", {})
        await ask("home", {})
        status = harness.engine.status()
        assert status.tared and status.homed
        assert await ask("jog", {"mm": -10}) == {"moved_mm": -10.0}
        taken = await ask("set", {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50})
        assert taken == {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50}
        await ask("approach", {})
        assert state_of(harness) is State.HOLD
        await harness.passes(1)
        assert harness.engine.status().force_g == pytest.approx(300, rel=0.05)
        assert harness.engine.status().force_set_g == 300
        await ask("run", {})
        assert state_of(harness) is State.HOLD
        await ask("retract", {})
        assert state_of(harness) is State.ARMED
        await ask("disarm", {})
        assert state_of(harness) is State.IDLE

    harness.play(person)


def test_a_jog_asked_for_before_a_stop_is_not_begun_after_it(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        await ask("arm", {})
        before = harness.engine.status().steps
        jog = asyncio.ensure_future(ask("jog", {"mm": 100}))
        await asyncio.sleep(0.001)
        await ask("stop", {})
        with pytest.raises(CommandRefused, match="a stop came first"):
            await jog
        await harness.passes(1)
        assert harness.engine.status().steps == before

    harness.play(person)


def test_refusals_are_sentences(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        for command, args, error, words in (
            ("dance", {}, WrongUse, "has no command"),
            ("arm", {"quickly": True}, WrongUse, "command arm"),
            (
                "jog",
                {"mm": 1},
                CommandRefused,
                "the drum is 'off'.*only while it is armed and lifted",
            ),
            ("jog", {"mm": 500}, WrongUse, "more than a turn"),
            ("jog", {"mm": "far"}, WrongUse, "must be a number"),
            ("set", {"speed_mm_s": "fast"}, WrongUse, "must be a number"),
            ("set", {"travel_mm": math.nan}, WrongUse, "must be a number"),
            ("set", {"speed_mm_s": 180}, WrongUse, "limits, 20 to 150: .*rig.toml"),
            ("set", {"force_g": 1300}, WrongUse, "limits, 50 to 1200"),
            ("set", {"travel_mm": 5000}, WrongUse, "the drum takes"),
            ("approach", {}, CommandRefused, "refused APPROACH in state IDLE"),
            ("pause", {}, WrongUse, "no run is active"),
            ("start", {}, WrongUse, "give a protocol"),
            ("start", {"protocol": "absent"}, WrongUse, "there is no protocol absent"),
            ("inject", {"fault": "earthquake"}, WrongUse, "has no fault"),
            ("inject", {"fault": "push", "args": 1}, WrongUse, "push"),
        ):
            with pytest.raises(error, match=words):
                await ask(command, args)

    harness.play(person)


def test_only_what_an_operator_may_set_is_set(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        await ask("arm", {})
        names = [entry.name for entry in register_table.SETTINGS]
        before = await harness.rig.drum.get(*names)
        for entry in register_table.SETTINGS:
            values = {"speed_mm_s": 100, entry.name: entry.low * entry.scale}
            with pytest.raises(WrongUse, match=f"{entry.name} is not an operator's setting"):
                await ask("set", values)
        after = await harness.rig.drum.get(*names)
        moved = {name for name in names if after[name] != before[name]}
        assert moved <= {"heartbeat"}  # not even the speed that came along

    harness.play(person)


def test_a_fault_is_injected_told_and_cleared(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        await ask("arm", {})
        await ask("inject", {"fault": "press_estop"})
        await harness.until(lambda: state_of(harness) is State.FAULT_OFF)
        assert "emergency stop" in harness.engine.status().fault_words
        with pytest.raises(CommandRefused):
            await ask("clear_fault", {})
        await ask("inject", {"fault": "release_estop"})
        await harness.passes(0.2)
        await ask("clear_fault", {})
        await harness.until(lambda: state_of(harness) is State.IDLE)

    harness.play(person)
    assert any("emergency stop" in text for text in harness.texts("fault"))


def test_the_encoders_range_is_taken_from_what_the_taxels_show(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        found = await asked(harness)("calibrate_range", {"seconds": 2})
        assert len(found["low"]) == len(found["high"]) == 18
        used = harness.engine.boards.encoder.normalisation
        assert np.array_equal(used.low, found["low"])
        await harness.passes(5)
        assert np.array_equal(harness.engine.boards.encoder.normalisation.high, found["high"])

    harness.play(person)


def test_what_the_boards_say_of_themselves_is_told_and_asked_for(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        boards = harness.engine.status().boards
        assert boards["drum"].reset == boards["taxels"].reset == "power-up"
        assert boards["taxels"].supply_v == pytest.approx(5.0, abs=0.05)
        assert boards["taxels"].self_test == ()
        assert boards["drum"].self_test is None
        assert await asked(harness)("test_taxels", {}) == {"found": []}

    harness.play(person)
    said = [text for text in harness.texts("board") if "self-test" in text]
    assert said == ["taxels' self-test: nothing found"] * 2


def test_a_protocol_is_started_held_and_ended_by_messages(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        ask = asked(harness)
        order = harness.order()
        started = await ask(
            "start", {"protocol": order.protocol, "out": order.out, "yes": True, "seed": 5}
        )
        assert started == {"session": str(harness.session)}
        with pytest.raises(WrongUse, match="a run is active"):
            await ask("arm", {})
        with pytest.raises(WrongUse, match="a run is active"):
            await ask("jog", {"mm": 1})
        await harness.until(lambda: state_of(harness) is State.RUN)
        status = harness.engine.status()
        assert status.run.current == CurrentTrial("A", 100.0, 500.0, 1)
        assert status.texture == "A"
        await harness.until(lambda: harness.engine.status().recording.active)
        await ask("pause", {})
        await harness.until(lambda: state_of(harness) is State.IDLE)
        assert harness.engine.status().run.state == "paused"
        await ask("resume", {})
        await harness.until(lambda: state_of(harness) is State.RUN)
        await ask("abort", {})
        await until_ended(harness)
        assert harness.engine.status().run.state == "aborted"
        assert not harness.engine.status().recording.active

    harness.play(person)


def test_the_beat_stays_away_when_the_run_hangs_and_the_drum_saves_itself(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def person(harness: EngineHarness) -> None:
        await harness.until(lambda: state_of(harness) is State.RUN)
        run = harness.engine.run
        assert run is not None
        monkeypatch.setattr(run.control, "check_in", lambda: None)
        monkeypatch.setattr(RunControl, "check", lambda self: None)
        await harness.until(lambda: harness.engine.heartbeat_gate.overdue == ["runner"], 2)
        await until_ended(harness)

    harness.play(person, harness.order())
    assert any("stopped calling" in text for text in harness.texts("fault"))
    assert harness.engine.run is not None and harness.engine.run.outcome == "failed"


def test_an_engine_without_client_and_run_ends_by_itself(harness: EngineHarness) -> None:
    async def person(harness: EngineHarness) -> None:
        await asked(harness)("arm", {})
        await harness.passes(60)

    harness.play(person)
    assert harness.exit_code == 0
    assert harness.rig.loop.time() < 20
