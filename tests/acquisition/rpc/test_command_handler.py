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
from tests.acquisition.floor import Floor, until_ended


def asked(floor: Floor) -> Any:
    """The desk of the floor's engine."""
    return CommandHandler(floor.engine).handle


def state_of(floor: Floor) -> State:
    return State(floor.engine.status().state)


def test_a_person_drives_the_drum_step_by_step(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        assert floor.engine.status().run == RunStatus()
        await ask("arm", {})
        assert state_of(floor) is State.ARMED
        await ask("tare", {})
        await ask("home", {})
        status = floor.engine.status()
        assert status.tared and status.homed
        assert await ask("jog", {"mm": -10}) == {"moved_mm": -10.0}
        taken = await ask("set", {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50})
        assert taken == {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50}
        await ask("approach", {})
        assert state_of(floor) is State.HOLD
        await floor.passes(1)
        assert floor.engine.status().force_g == pytest.approx(300, rel=0.05)
        assert floor.engine.status().force_set_g == 300
        await ask("run", {})
        assert state_of(floor) is State.HOLD
        await ask("retract", {})
        assert state_of(floor) is State.ARMED
        await ask("disarm", {})
        assert state_of(floor) is State.IDLE

    floor.play(person)


def test_a_jog_asked_for_before_a_stop_is_not_begun_after_it(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        await ask("arm", {})
        before = floor.engine.status().steps
        jog = asyncio.ensure_future(ask("jog", {"mm": 100}))
        await asyncio.sleep(0.001)
        await ask("stop", {})
        with pytest.raises(CommandRefused, match="a stop came first"):
            await jog
        await floor.passes(1)
        assert floor.engine.status().steps == before

    floor.play(person)


def test_refusals_are_sentences(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        for command, args, error, words in (
            ("dance", {}, WrongUse, "knows no command"),
            ("arm", {"quickly": True}, WrongUse, "command arm"),
            ("jog", {"mm": 1}, CommandRefused, "the drum is 'off'.*armed and lifted only"),
            ("jog", {"mm": 500}, WrongUse, "more than a turn"),
            ("jog", {"mm": "far"}, WrongUse, "must be a number"),
            ("set", {"speed_mm_s": "fast"}, WrongUse, "must be a number"),
            ("set", {"travel_mm": math.nan}, WrongUse, "must be a number"),
            ("set", {"speed_mm_s": 180}, WrongUse, "limits, 20 to 150: .*rig.toml"),
            ("set", {"force_g": 1300}, WrongUse, "limits, 50 to 1200"),
            ("set", {"travel_mm": 5000}, WrongUse, "the drum takes"),
            ("approach", {}, CommandRefused, "refused APPROACH in state IDLE"),
            ("pause", {}, WrongUse, "no run is going"),
            ("start", {}, WrongUse, "give a protocol"),
            ("start", {"protocol": "absent"}, WrongUse, "there is no protocol absent"),
            ("inject", {"fault": "earthquake"}, WrongUse, "knows no fault"),
            ("inject", {"fault": "push", "args": 1}, WrongUse, "push"),
        ):
            with pytest.raises(error, match=words):
                await ask(command, args)

    floor.play(person)


def test_only_what_an_operator_may_set_is_set(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        await ask("arm", {})
        names = [entry.name for entry in register_table.SETTINGS]
        before = await floor.rig.drum.get(*names)
        for entry in register_table.SETTINGS:
            values = {"speed_mm_s": 100, entry.name: entry.low * entry.scale}
            with pytest.raises(WrongUse, match=f"{entry.name} is not for an operator to set"):
                await ask("set", values)
        after = await floor.rig.drum.get(*names)
        moved = {name for name in names if after[name] != before[name]}
        assert moved <= {"heartbeat"}  # not even the speed that came along

    floor.play(person)


def test_a_fault_is_injected_told_and_cleared(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        await ask("arm", {})
        await ask("inject", {"fault": "press_estop"})
        await floor.until(lambda: state_of(floor) is State.FAULT_OFF)
        assert "emergency stop" in floor.engine.status().fault_words
        with pytest.raises(CommandRefused):
            await ask("clear_fault", {})
        await ask("inject", {"fault": "release_estop"})
        await floor.passes(0.2)
        await ask("clear_fault", {})
        await floor.until(lambda: state_of(floor) is State.IDLE)

    floor.play(person)
    assert any("emergency stop" in text for text in floor.texts("fault"))


def test_the_encoders_range_is_taken_from_what_the_taxels_show(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        found = await asked(floor)("calibrate_range", {"seconds": 2})
        assert len(found["low"]) == len(found["high"]) == 18
        used = floor.engine.boards.encoder.normalisation
        assert np.array_equal(used.low, found["low"])
        await floor.passes(5)
        assert np.array_equal(floor.engine.boards.encoder.normalisation.high, found["high"])

    floor.play(person)


def test_what_the_boards_say_of_themselves_is_told_and_asked_for(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        boards = floor.engine.status().boards
        assert boards["drum"].reset == boards["taxels"].reset == "power-up"
        assert boards["taxels"].supply_v == pytest.approx(5.0, abs=0.05)
        assert boards["taxels"].self_test == ()
        assert boards["drum"].self_test is None
        assert await asked(floor)("test_taxels", {}) == {"found": []}

    floor.play(person)
    said = [text for text in floor.texts("board") if "self-test" in text]
    assert said == ["taxels' self-test: nothing found"] * 2


def test_a_protocol_is_started_held_and_ended_by_messages(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        ask = asked(floor)
        order = floor.order()
        started = await ask(
            "start", {"protocol": order.protocol, "out": order.out, "yes": True, "seed": 5}
        )
        assert started == {"session": str(floor.session)}
        with pytest.raises(WrongUse, match="a run is going"):
            await ask("arm", {})
        with pytest.raises(WrongUse, match="a run is going"):
            await ask("jog", {"mm": 1})
        await floor.until(lambda: state_of(floor) is State.RUN)
        status = floor.engine.status()
        assert status.run.current == CurrentTrial("A", 100.0, 500.0, 1)
        assert status.texture == "A"
        await floor.until(lambda: floor.engine.status().recording.active)
        await ask("pause", {})
        await floor.until(lambda: state_of(floor) is State.IDLE)
        assert floor.engine.status().run.state == "paused"
        await ask("resume", {})
        await floor.until(lambda: state_of(floor) is State.RUN)
        await ask("abort", {})
        await until_ended(floor)
        assert floor.engine.status().run.state == "aborted"
        assert not floor.engine.status().recording.active

    floor.play(person)


def test_the_beat_stays_away_when_the_run_hangs_and_the_drum_saves_itself(
    floor: Floor, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def person(floor: Floor) -> None:
        await floor.until(lambda: state_of(floor) is State.RUN)
        run = floor.engine.run
        assert run is not None
        monkeypatch.setattr(run.control, "check_in", lambda: None)
        monkeypatch.setattr(RunControl, "check", lambda self: None)
        await floor.until(lambda: floor.engine.vitals.silent == ["runner"], 2)
        await until_ended(floor)

    floor.play(person, floor.order())
    assert any("stopped calling" in text for text in floor.texts("fault"))
    assert floor.engine.run is not None and floor.engine.run.ending == "failed"


def test_an_engine_without_client_and_run_ends_by_itself(floor: Floor) -> None:
    async def person(floor: Floor) -> None:
        await asked(floor)("arm", {})
        await floor.passes(60)

    floor.play(person)
    assert floor.exit_code == 0
    assert floor.rig.loop.time() < 20
