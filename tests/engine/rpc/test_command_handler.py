"""The engine's commands and their results."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from rigctl.boards import drum_registers
from rigctl.boards.drum_states import State
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.rpc.messages import CurrentTrial, RunStatus, decode_request
from rigctl.engine.run_control import RunControl
from rigctl.errors import CommandRefused, WrongUse
from tests.engine.engine_harness import EngineHarness, until_ended


def handler_of(harness: EngineHarness) -> Any:
    """Return the request handler of the harness's engine."""
    return DrumCommands(harness.engine).handle


def state_of(harness: EngineHarness) -> State:
    return State(harness.engine.status().state)


async def test_commands_control_the_drum_step_by_step(harness: EngineHarness) -> None:
    handle = handler_of(harness)
    assert harness.engine.status().run == RunStatus()
    await handle("arm", {})
    assert state_of(harness) is State.ARMED
    await handle("tare", {})
    await handle("home", {})
    status = harness.engine.status()
    assert status.tared and status.homed
    assert await handle("jog", {"mm": -10}) == {"moved_mm": -10.0}
    taken = await handle("set", {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50})
    assert taken == {"speed_mm_s": 100, "force_g": 300, "travel_mm": 50}
    await handle("approach", {})
    assert state_of(harness) is State.HOLD
    await harness.wait(1)
    assert harness.engine.status().force_g == pytest.approx(300, rel=0.05)
    assert harness.engine.status().force_set_g == 300
    await handle("run", {})
    assert state_of(harness) is State.HOLD
    await handle("retract", {})
    assert state_of(harness) is State.ARMED
    await handle("disarm", {})
    assert state_of(harness) is State.IDLE


async def test_a_jog_requested_before_a_stop_does_not_start_after_it(
    harness: EngineHarness,
) -> None:
    handle = handler_of(harness)
    await handle("arm", {})
    before = harness.engine.status().steps
    jog = asyncio.ensure_future(handle("jog", {"mm": 100}))
    await asyncio.sleep(0.001)
    await handle("stop", {})
    with pytest.raises(CommandRefused, match="a stop came first"):
        await jog
    await harness.wait(1)
    assert harness.engine.status().steps == before


START = b'{"id":4,"command":"start","args":{"protocol":"PROTOCOL","out":"OUT","yes":true}}'
APPROACH = b'{"id":5,"command":"approach"}'


@pytest.mark.parametrize("ending", [b'{"id":6,"command":"stop"}', b'{"id":6,"command":"retract"}'])
def test_no_run_begins_during_a_move_by_hand(harness: EngineHarness, ending: bytes) -> None:
    """The move would end with the run that began in its midst, and neither knew of the other."""

    async def scenario(harness: EngineHarness) -> None:
        async def send(line: bytes) -> Any:
            request = decode_request(line)
            return await handler_of(harness)(request.command, request.args)

        run = harness.request()
        start = START.replace(b"PROTOCOL", run.protocol.encode()).replace(b"OUT", run.out.encode())
        for command in ("arm", "tare", "home"):
            await handler_of(harness)(command, {})
        approach = asyncio.ensure_future(send(APPROACH))
        await harness.until(lambda: state_of(harness) is State.APPROACH)
        with pytest.raises(WrongUse, match=r"moved by hand: .*then start again"):
            await send(start)
        assert harness.engine.run is None and not approach.done()
        await send(ending)
        ended_s = harness.rig.loop.time()
        with pytest.raises(CommandRefused, match="interrupted: a stop or another command came"):
            await approach
        assert harness.rig.loop.time() < ended_s + 1
        await harness.until(lambda: state_of(harness) is State.ARMED)
        await send(start)
        await until_ended(harness)

    harness.run(scenario)
    assert harness.engine.run is not None and harness.engine.run.outcome == "done"


def test_an_engine_that_ends_before_its_scenario_fails_the_test(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        harness.engine.shut_down("in the midst of it")
        await harness.wait(60)

    with pytest.raises(AssertionError, match="who ended first"):
        harness.run(scenario)


async def test_refusals_are_sentences(harness: EngineHarness) -> None:
    handle = handler_of(harness)
    for command, args, error, words in (
        ("dance", {}, WrongUse, "has no command"),
        ("arm", {"quickly": True}, WrongUse, "command arm"),
        (
            "jog",
            {"mm": 1},
            CommandRefused,
            "'off'.*only while it is armed and lifted",
        ),
        ("jog", {"mm": 500}, WrongUse, "more than a turn"),
        ("jog", {"mm": "far"}, WrongUse, "command jog: mm: expected a number, got a text"),
        ("set", {"speed_mm_s": "fast"}, WrongUse, "expected a number"),
        ("set", {"travel_mm": math.nan}, WrongUse, "expected a number >= 0"),
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
            await handle(command, args)


async def test_a_turning_drum_takes_another_force_and_refuses_another_speed(
    harness: EngineHarness,
) -> None:
    """The speed was taken, logged and shown while the drum turned on with the old one."""
    handle, status = handler_of(harness), harness.engine.status
    for command in ("arm", "tare", "home"):
        await handle(command, {})
    await handle("set", {"speed_mm_s": 40, "force_g": 300, "travel_mm": 100})
    await handle("approach", {})
    run = asyncio.ensure_future(handle("run", {}))
    await harness.until(lambda: state_of(harness) is State.RUN)
    for name, value in {"speed_mm_s": 80, "travel_mm": 50, "run_in_mm": 60}.items():
        with pytest.raises(CommandRefused, match=r"set speed, .* once it holds still or is"):
            await handle("set", {name: value, "force_g": 500})
    assert (status().speed_set_mm_s, status().force_set_g) == (40, 300)
    await handle("set", {"force_g": 400})
    await harness.wait(1)
    assert status().speed_mm_s == pytest.approx(40, rel=0.01)
    assert status().force_g == pytest.approx(400, rel=0.05)
    await run
    await handle("set", {"speed_mm_s": 80})
    assert status().speed_set_mm_s == 80


async def test_only_operator_settings_can_be_set(harness: EngineHarness) -> None:
    handle = handler_of(harness)
    await handle("arm", {})
    names = [entry.name for entry in drum_registers.SETTINGS]
    before = await harness.rig.drum.get(*names)
    for entry in drum_registers.SETTINGS:
        values = {"speed_mm_s": 100, entry.name: entry.low * entry.scale}
        with pytest.raises(WrongUse, match=f"unknown field {entry.name}; it takes speed_mm_s"):
            await handle("set", values)
    after = await harness.rig.drum.get(*names)
    moved = {name for name in names if after[name] != before[name]}
    assert moved <= {"heartbeat"}  # not even the speed that came along


def test_a_fault_is_injected_published_and_cleared(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        handle = handler_of(harness)
        await handle("arm", {})
        await handle("inject", {"fault": "press_estop"})
        await harness.until(lambda: state_of(harness) is State.FAULT_OFF)
        assert "emergency stop" in harness.engine.status().fault_words
        with pytest.raises(CommandRefused):
            await handle("clear_fault", {})
        await handle("inject", {"fault": "release_estop"})
        await harness.wait(0.2)
        await handle("clear_fault", {})
        await harness.until(lambda: state_of(harness) is State.IDLE)

    harness.run(scenario)
    assert any("emergency stop" in text for text in harness.texts("fault"))


def test_the_status_of_the_boards_is_published_and_requested(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        boards = harness.engine.status().boards
        assert boards["drum"].reset == boards["taxels"].reset == "power-up"
        assert boards["taxels"].supply_v == pytest.approx(5.0, abs=0.05)
        assert boards["taxels"].self_test == ()
        assert boards["drum"].self_test is None
        assert await handler_of(harness)("test_taxels", {}) == {"found": []}

    harness.run(scenario)
    texts = [text for text in harness.texts("board") if "self-test" in text]
    assert texts == ["self-test of the taxels: no findings"] * 2


async def test_commands_start_pause_and_abort_a_protocol(harness: EngineHarness) -> None:
    handle = handler_of(harness)
    order = harness.request()
    started = await handle(
        "start", {"protocol": order.protocol, "out": order.out, "yes": True, "seed": 5}
    )
    assert started == {"session": str(harness.session)}
    with pytest.raises(WrongUse, match="a run is active"):
        await handle("arm", {})
    with pytest.raises(WrongUse, match="a run is active"):
        await handle("jog", {"mm": 1})
    await harness.until(lambda: state_of(harness) is State.RUN)
    status = harness.engine.status()
    assert status.run.current == CurrentTrial("A", 100.0, 500.0, 1)
    assert status.texture == "A"
    await harness.until(lambda: harness.engine.status().recording.active)
    await handle("pause", {})
    await harness.until(lambda: state_of(harness) is State.IDLE)
    assert harness.engine.status().run.state == "paused"
    await handle("resume", {})
    await harness.until(lambda: state_of(harness) is State.RUN)
    await handle("abort", {})
    await until_ended(harness)
    assert harness.engine.status().run.state == "aborted"
    assert not harness.engine.status().recording.active


def test_a_run_that_hangs_stops_the_heartbeat_and_the_drum_lifts(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: state_of(harness) is State.RUN)
        run = harness.engine.run
        assert run is not None
        monkeypatch.setattr(run.control, "check_in", lambda: None)
        monkeypatch.setattr(RunControl, "check", lambda self: None)
        await harness.until(lambda: harness.engine.heartbeat_gate.overdue == ["runner"], 2)
        await until_ended(harness)

    harness.run(scenario, harness.request())
    assert any("stopped calling" in text for text in harness.texts("fault"))
    assert harness.engine.run is not None and harness.engine.run.outcome == "failed"


def test_an_engine_without_client_and_run_ends(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await handler_of(harness)("arm", {})
        await harness.wait(60)

    harness.run(scenario, engine_ends=True)
    assert harness.exit_code == 0
    assert harness.rig.loop.time() < 20
