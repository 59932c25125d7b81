"""A drum that did not hear the computer is brought back; what else stopped it ends the run."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

import pytest

from rigctl.bench import virtual_rig
from rigctl.boards.drum_states import State
from rigctl.engine.runner import RECOVERIES
from rigctl.session.verify import verify
from rigctl.values import Block, DrumState, Event
from tests.engine.engine_harness import (
    EngineHarness,
    Scenario,
    open_harness,
    open_session,
    until_ended,
)
from tests.engine.protocol.test_interruptions import PAIR, drum_state, until_turning, verdicts
from tests.firmware.building import host_library

STALL_S = 0.4
"""Longer than the drum waits for a heartbeat, shorter than its lift."""
MOVING = (State.POSITION, State.APPROACH, State.HOLD, State.RUN, State.RETRACT)


def stall(harness: EngineHarness, seconds: float = STALL_S) -> None:
    """Let the computer do nothing for a time."""
    harness.rig.faults.stall_computer(seconds)


def sleep(harness: EngineHarness, seconds: float) -> None:
    """Let the computer sleep: what the boards send meanwhile is lost."""
    faults = harness.rig.faults
    for board in ("drum", "taxels"):
        faults.stall(board)
    stall(harness, seconds)
    for board in ("drum", "taxels"):
        faults.stall(board, False)


def events_of_session(harness: EngineHarness, kind: str) -> list[str]:
    """Return the texts of the events of a kind that the session holds."""
    with open_session(harness.session) as session:
        return [event.text for event in session.events if event.kind == kind]


def check_repeated(harness: EngineHarness) -> None:
    """Check that each trial was committed once after it was given up, and that it says why."""
    run = harness.engine.run
    assert run is not None and run.complete and run.status().trials_committed == 2
    committed = [row for row in verdicts(harness) if row[1] == "committed"]
    assert committed == [(1, "committed"), (2, "committed")]
    assert events_of_session(harness, "recovery")
    assert verify(harness.session).whole


@pytest.mark.parametrize("state", MOVING, ids=lambda state: state.name)
def test_a_computer_that_stalls_costs_one_attempt(harness: EngineHarness, state: State) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: drum_state(harness) is state)
        stall(harness)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    check_repeated(harness)
    (late,) = events_of_session(harness, "late")
    assert "asleep or too busy for 0." in late


def test_a_board_lost_in_the_lift_behind_a_trial_costs_no_second_one(
    harness: EngineHarness,
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await harness.until(lambda: "trial 1 committed" in harness.texts("trial"))
        await harness.until(lambda: drum_state(harness) is State.RETRACT)
        harness.rig.faults.unplug("drum")
        await harness.wait(3)
        harness.rig.faults.replug("drum")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    check_repeated(harness)
    assert verdicts(harness) == [(1, "committed"), (2, "committed")]


def test_a_short_stall_costs_nothing(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        stall(harness, 0.12)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert verdicts(harness) == [(1, "committed"), (2, "committed")]
    assert not harness.texts("recovery") and not harness.texts("late")


@pytest.mark.parametrize("seconds", [2.0, 100.0])
def test_a_run_goes_on_after_the_computer_slept(harness: EngineHarness, seconds: float) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        sleep(harness, seconds)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    check_repeated(harness)
    (late,) = [event for event in harness.events if event.kind == "late"]
    assert late.data["late_s"] == pytest.approx(seconds, abs=0.15)
    told_s = late.text.removeprefix("this computer was asleep or too busy for ").removesuffix(" s")
    assert float(told_s) == pytest.approx(seconds, abs=0.2) and "e" not in told_s


def test_a_stall_while_the_run_is_paused_asks_nobody(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        run = harness.engine.run
        assert run is not None
        run.control.pause()
        await harness.until(lambda: drum_state(harness) is State.RETRACT)
        stall(harness, 2.0)
        await harness.wait(3)
        assert run.status().reasons == ("operator",)
        run.control.resume()
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None and harness.engine.run.complete


@pytest.mark.parametrize("kind", ["virtual", "firmware"])
def test_a_drum_cable_that_is_plugged_in_again_costs_one_attempt(tmp_path: Path, kind: str) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        harness.rig.faults.unplug("drum")
        await harness.wait(3)
        assert harness.engine.status().run.reasons == ("link",)
        harness.rig.faults.replug("drum")
        await until_ended(harness)

    with open_harness(tmp_path, rig_kind=kind) as harness:
        harness.run(scenario, harness.request(PAIR))
        check_repeated(harness)


def test_a_question_waits_for_a_drum_that_is_lost(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        run = harness.engine.run
        assert run is not None
        await harness.until(lambda: run.status().prompt is not None)
        harness.rig.faults.unplug("drum")
        await harness.wait(2)
        assert run.status().reasons == ("link", "prompt")
        harness.rig.faults.replug("drum")
        await harness.wait(2)
        prompt = run.status().prompt
        assert prompt is not None and run.status().reasons == ("prompt",)
        run.control.answer(prompt.id, "ok")
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR, yes=False))
    assert harness.engine.run is not None and harness.engine.run.complete


def test_a_step_is_begun_again_a_few_times_only(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        for _ in range(RECOVERIES + 1):
            await until_turning(harness)
            stall(harness)
            await harness.until(lambda: drum_state(harness) is State.FAULT_OFF)
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    run = harness.engine.run
    assert run is not None and run.outcome == "failed" and "stopped calling" in run.text
    assert len(harness.texts("recovery")) == RECOVERIES


def test_each_step_has_recoveries_of_its_own(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        for trial in (1, 2):
            for _ in range(RECOVERIES):
                await until_turning(harness)
                stall(harness)
                await harness.until(lambda: drum_state(harness) is State.FAULT_OFF)
            done = f"trial {trial} committed"
            await harness.until(lambda: done in harness.texts("trial"))  # noqa: B023
        await until_ended(harness)

    harness.run(scenario, harness.request(PAIR))
    assert harness.engine.run is not None and harness.engine.run.complete
    assert len(harness.texts("recovery")) == 2 * RECOVERIES


async def press_estop(harness: EngineHarness) -> None:
    harness.rig.faults.press_estop()
    stall(harness)
    harness.rig.faults.release_estop()


async def press_too_hard(harness: EngineHarness) -> None:
    harness.rig.faults.push(1500.0)
    stall(harness)
    harness.rig.faults.push(0.0)


async def jam(harness: EngineHarness) -> None:
    harness.rig.faults.jam_motor()
    await harness.until(lambda: drum_state(harness) in (State.FAULT_LIFT, State.FAULT_OFF))
    harness.rig.faults.jam_motor(False)
    stall(harness, 2.0)


async def break_wire(harness: EngineHarness) -> None:
    harness.rig.faults.wire("potentiometer wiper open")
    stall(harness, 2.0)
    harness.rig.faults.wire("potentiometer wiper open", False)


async def press_estop_while_asleep(harness: EngineHarness) -> None:
    """The drum has missed its heartbeat and is off already when somebody presses and releases."""
    stall(harness, 2.0)
    await press_estop(harness)


NEVER: dict[Scenario, str] = {
    press_estop: "emergency stop",
    press_too_hard: "force above the limit",
    jam: "index mark and counted steps disagree",
    break_wire: "potentiometer",
    press_estop_while_asleep: "emergency stop",
}


@pytest.mark.parametrize("cause", NEVER, ids=lambda cause: cause.__name__)
def test_what_else_stopped_the_drum_is_never_cleared(
    harness: EngineHarness, cause: Scenario
) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        await cause(harness)
        await until_ended(harness)
        await harness.wait(3)
        assert drum_state(harness) is State.FAULT_OFF

    harness.run(scenario, harness.request(PAIR))
    run = harness.engine.run
    assert run is not None and run.outcome == "failed"
    assert NEVER[cause] in run.text
    assert not harness.texts("recovery")


def test_a_board_whose_missed_heartbeat_hides_a_stop_starts_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The control of the case above: this firmware is broken, and the drum would move again."""

    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)
        await press_estop_while_asleep(harness)
        await until_ended(harness)

    library = host_library("drum", "heartbeat-hides", tmp_path / "broken.so")
    opened = partial(virtual_rig.open_virtual_rig, drum_library=library)
    monkeypatch.setattr(virtual_rig, "open_virtual_rig", opened)
    with open_harness(tmp_path) as harness:
        harness.run(scenario, harness.request(PAIR))
        assert harness.texts("recovery")


def test_a_poll_loop_that_fails_ends_run_and_engine(harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)

        def fail(state: DrumState) -> None:
            raise ValueError("a subscriber failed")

        harness.engine.boards.drum_poller.subscribe(fail)
        await asyncio.sleep(60)

    harness.run(scenario, harness.request(PAIR), engine_ends=True)
    assert any("a subscriber failed" in text for text in harness.texts("fault"))
    assert verdicts(harness) == [(1, "aborted")]
    assert verify(harness.session).whole


def test_a_consumer_of_samples_that_fails_ends_run_and_engine(harness: EngineHarness) -> None:
    """The engine once went on without samples, and each later run blamed the sync wire."""

    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)

        def fail(block: Block) -> None:
            raise ValueError("an encoder failed")

        harness.engine.boards.pipeline.subscribe(fail)
        await asyncio.sleep(60)

    harness.run(scenario, harness.request(PAIR), engine_ends=True)
    run = harness.engine.run
    assert run is not None and run.outcome == "failed" and "an encoder failed" in run.text
    assert verdicts(harness) == [(1, "aborted")]
    assert verify(harness.session).whole


def test_a_consumer_of_events_that_fails_ends_run_and_engine(harness: EngineHarness) -> None:
    """The engine itself once raised, with the drum left to the board."""

    async def scenario(harness: EngineHarness) -> None:
        await until_turning(harness)

        def fail(event: Event) -> None:
            raise ValueError("a listener failed")

        harness.engine.event_bus.subscribe(fail)
        harness.engine.event_bus.publish("log", "what it fails at")
        await asyncio.sleep(60)

    harness.run(scenario, harness.request(PAIR), engine_ends=True)
    assert any("a listener failed" in text for text in harness.texts("fault"))
    assert verdicts(harness) == [(1, "aborted")]
    assert verify(harness.session).whole
