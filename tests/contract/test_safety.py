"""Faults of a bench leave a safe drum, on both kinds of boards."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.bench.simulated_rig import DRUM, TAXELS
from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State
from rigctl.errors import BoardRebooted, CommandRefused, LinkLost
from tests.contract.noise import bear_noise
from tests.contract.operator import Operator

QUICK = {"force_set": 300.0, "speed_set": 80.0, "run_in_set": 30.0, "travel_set": 245.0}
LIFT_LIMIT_S = 6.0


@pytest.fixture(autouse=True)
def sound_bench(operator: Operator) -> None:
    """Start every test with a bench without faults, and a new record."""
    faults = operator.faults
    faults.release_estop()
    faults.push(0.0)
    for put_right in (faults.loadcell_silent, faults.loadcell_frozen, faults.loadcell_saturated):
        put_right(False)
    for board in (DRUM, TAXELS):
        faults.replug(board)
    operator.run(_settle(operator))
    operator.clear_record()


async def _settle(operator: Operator) -> None:
    if not operator.drum.connected:
        await operator.drum.connect()
    await operator.drum.set(**QUICK, clock_trim_ppm=operator.clocks_ppm["drum"])
    await operator.poll(False)


async def wait_for_fault(operator: Operator, within_s: float = 0.5) -> float:
    """Poll every 5 ms until a fault is latched; return the seconds."""
    start_s = operator.now_s
    while not (await operator.poll()).fault:
        assert operator.now_s - start_s < within_s, "no fault latched in time"
        await asyncio.sleep(0.005)
    return operator.now_s - start_s


def true_force_g(operator: Operator) -> float:
    return float(operator.simulation.truth.arrays().force_g[-1])


def true_speed_mm_s(operator: Operator) -> float:
    return float(operator.simulation.truth.arrays().speed_mm_s[-1])


async def check_lift_then_off(operator: Operator, cause: Fault) -> None:
    """Check that the fault lifts the drum, for a set time, and then switches everything off."""
    assert (operator.state, operator.fault) == (State.FAULT_LIFT, cause)
    off = await operator.until_state(State.FAULT_OFF, LIFT_LIMIT_S)
    assert off.fault == cause
    assert (off.speed_mm_s, off.actuator_drive_permille) == (0.0, 0)
    assert true_force_g(operator) == 0.0


@pytest.mark.parametrize("state", [State.ARMED, State.HOLD, State.RUN])
async def test_an_emergency_stop_switches_everything_off(operator: Operator, state: State) -> None:
    await operator.reach(state)
    await operator.watch(0.1)
    operator.faults.press_estop()
    await asyncio.sleep(0.005)
    stopped = await operator.poll()
    assert (stopped.state, stopped.fault) == (State.FAULT_OFF, Fault.ESTOP)
    assert (stopped.speed_mm_s, stopped.actuator_drive_permille) == (0.0, 0)
    assert not stopped.status_bits >> Status.ESTOP_CLOSED & 1
    assert not stopped.status_bits >> Status.SYNC_HIGH & 1
    steps = stopped.steps
    await operator.watch(0.1)
    assert operator.states[-1].steps == steps
    assert true_speed_mm_s(operator) == 0.0
    for command in (Command.CLEAR, Command.ARM):
        with pytest.raises(CommandRefused, match="emergency stop pressed"):
            await operator.drum.command(command)
    operator.faults.release_estop()
    await operator.watch(0.1)
    assert (operator.state, operator.fault) == (State.FAULT_OFF, Fault.ESTOP)
    await operator.do(Command.CLEAR)
    assert (operator.state, operator.fault) == (State.IDLE, Fault.NONE)


async def test_an_open_emergency_stop_forbids_to_arm(operator: Operator) -> None:
    await operator.reach(State.IDLE)
    operator.faults.press_estop()
    await operator.watch(0.1)
    with pytest.raises(CommandRefused):
        await operator.drum.command(Command.ARM)


@pytest.mark.parametrize("state", [State.HOLD, State.RUN])
async def test_too_much_force_lifts_immediately(operator: Operator, state: State) -> None:
    await operator.reach(state)
    operator.faults.push(1500.0)
    assert await wait_for_fault(operator) < 0.1
    operator.faults.push(0.0)
    await check_lift_then_off(operator, Fault.OVER_FORCE)


@pytest.mark.parametrize(
    ("what", "state", "within_s"),
    [
        (Fault.LOADCELL_SILENT, State.HOLD, 0.08),
        (Fault.LOADCELL_SILENT, State.RUN, 0.08),
        (Fault.LOADCELL_FROZEN, State.HOLD, 0.8),
        (Fault.LOADCELL_SATURATED, State.HOLD, 0.08),
    ],
    ids=lambda value: value.name if isinstance(value, Fault | State) else None,
)
async def test_a_load_cell_that_fails_lifts(
    operator: Operator, what: Fault, state: State, within_s: float
) -> None:
    await operator.reach(state)
    await operator.watch(0.2)
    break_it = getattr(operator.faults, what.name.lower())
    break_it(True)
    assert await wait_for_fault(operator, 1.0) < within_s
    assert operator.states[-1].fault_bits >> what & 1
    await check_lift_then_off(operator, what)
    with pytest.raises(CommandRefused):
        await operator.drum.command(Command.CLEAR)
    break_it(False)
    await operator.watch(0.3)
    await operator.do(Command.CLEAR)


async def test_without_a_heartbeat_the_drum_ramps_down_lifts_and_switches_off(
    operator: Operator,
) -> None:
    await operator.reach(State.RUN)
    await operator.watch(0.2)
    await asyncio.sleep(0.2)
    assert (await operator.poll()).fault == 0
    last_beat_s = operator.now_s
    state = await operator.until(lambda s: s.fault != 0, 1.0, beat=False)
    assert state.at_s - last_beat_s == pytest.approx(0.25, abs=0.06)
    assert (operator.state, operator.fault) == (State.FAULT_LIFT, Fault.HEARTBEAT)
    off = await operator.until(lambda s: s.state == State.FAULT_OFF, 2.0, beat=False)
    assert off.at_s - last_beat_s == pytest.approx(1.0, abs=0.1)
    assert (off.speed_mm_s, off.actuator_drive_permille) == (0.0, 0)
    assert true_force_g(operator) == 0.0


async def test_an_idle_drum_needs_no_heartbeat(operator: Operator) -> None:
    await operator.reach(State.IDLE)
    await operator.watch(1.2, beat=False)
    assert (operator.state, operator.fault) == (State.IDLE, Fault.NONE)


async def test_no_contact_within_the_travel_allowed_is_a_fault(operator: Operator) -> None:
    await operator.reach(State.ARMED)
    await operator.drum.set(approach_limit_um=1000)
    await operator.drum.command(Command.APPROACH)
    await operator.until(lambda state: state.fault != Fault.NONE)
    assert FAULT_TEXT[operator.fault].startswith("no contact within the set travel")
    await operator.drum.set(approach_limit_um=30000)
    await check_lift_then_off(operator, Fault.NO_CONTACT)


async def test_a_stop_while_running_lifts_and_leaves_the_drum_armed(operator: Operator) -> None:
    await operator.reach(State.RUN)
    await operator.watch(0.3)
    await operator.drum.stop()
    assert State((await operator.poll()).state) is State.RETRACT
    armed = await operator.until_state(State.ARMED)
    assert (armed.speed_mm_s, armed.fault) == (0.0, 0)
    assert not armed.status_bits >> Status.SYNC_HIGH & 1
    assert true_force_g(operator) == 0.0


async def test_a_pulled_drum_cable_is_detected_and_the_drum_lifts(operator: Operator) -> None:
    await operator.reach(State.RUN)
    boots = operator.drum.identity.boot_count
    operator.faults.unplug(DRUM)
    assert await operator.lost(operator.poll) < 0.3
    await asyncio.sleep(1.5)
    assert true_force_g(operator) == 0.0
    assert true_speed_mm_s(operator) == 0.0
    with pytest.raises(LinkLost, match="plug the board in"):
        await operator.drum.connect()
    operator.faults.replug(DRUM)
    await operator.drum.connect()
    assert (operator.drum.rebooted, operator.drum.identity.boot_count) == (False, boots)
    assert (await operator.poll()).fault == Fault.HEARTBEAT


async def test_a_silent_drum_line_is_detected(operator: Operator) -> None:
    await operator.poll()
    operator.faults.stall(DRUM)
    seen_s = await operator.lost(operator.poll)
    operator.faults.stall(DRUM, False)
    assert seen_s < 0.3
    await operator.poll()


async def test_a_drum_board_that_restarts_is_detected_and_idle(operator: Operator) -> None:
    await operator.reach(State.HOLD)
    boots = operator.drum.identity.boot_count
    operator.faults.reset(DRUM)
    assert await operator.lost(operator.poll) < 0.5
    await operator.drum.connect()
    assert operator.drum.rebooted
    assert operator.drum.identity.boot_count == boots + 1
    state = await operator.until_state(State.IDLE)
    assert (state.fault, state.actuator_drive_permille) == (0, 0)


def test_a_noisy_drum_line_changes_nothing_but_the_counters(operator: Operator) -> None:
    operator.run(bear_noise(operator))


async def test_a_command_whose_reply_is_lost_is_repeated_and_executed_once(
    operator: Operator,
) -> None:
    await operator.reach(State.HOLD)
    rises, timeouts = operator.states[-1].sync_count, operator.drum.modbus.timeouts
    operator.faults.drop_bytes(DRUM, "to_host", 1.0)
    operator.rig.loop.call_later(0.1, operator.faults.drop_bytes, DRUM, "to_host", 0.0)
    # A drum that took the second request for a new one would refuse it: it runs already.
    await operator.drum.command(Command.RUN)
    assert operator.drum.modbus.timeouts - timeouts == 2
    await operator.until_state(State.RUN)
    state = await operator.until_state(State.HOLD)
    await operator.watch(0.5)
    assert operator.state is State.HOLD
    assert state.sync_count == rises + 1


async def test_a_pulled_taxel_cable_is_detected_and_lost_samples_are_counted(
    operator: Operator,
) -> None:
    await operator.reach(State.IDLE)
    await operator.watch(0.2)
    boots, lost = operator.taxels.identity.boot_count, operator.taxels.counters.lost
    operator.faults.unplug(TAXELS)
    last = int(operator.counters[-1])
    assert [type(fault) for fault in operator.taxel_faults] == [LinkLost]
    await operator.watch(1.0)
    operator.faults.replug(TAXELS)
    operator.blocks.clear()
    await operator.taxels.connect()
    await operator.watch(0.3)
    assert (operator.taxels.rebooted, operator.taxels.identity.boot_count) == (False, boots)
    (gap,) = [gap for block in operator.blocks for gap in block.gaps]
    assert (gap.first_counter, gap.count) == (last + 1, int(operator.counters[0]) - last - 1)
    assert operator.taxels.counters.lost == lost + gap.count
    assert 1000 < gap.count < 1400


async def test_a_silent_taxel_line_is_detected(operator: Operator) -> None:
    await operator.watch(0.1)
    operator.faults.stall(TAXELS)
    stalled_s = operator.now_s
    await operator.until(lambda _: bool(operator.taxel_faults), 1.0)
    operator.faults.stall(TAXELS, False)
    assert operator.now_s - stalled_s < 0.35
    assert not operator.taxels.connected
    await operator.taxels.connect()


async def test_a_taxel_board_that_restarts_is_reported(operator: Operator) -> None:
    await operator.watch(0.1)
    boots = operator.taxels.status.boot_count if operator.taxels.status else 0
    operator.faults.reset(TAXELS)
    await operator.watch(1.0)
    assert [type(fault) for fault in operator.taxel_faults] == [BoardRebooted]
    assert operator.taxels.status is not None
    assert operator.taxels.status.boot_count == boots + 1
    assert int(operator.counters[-1]) < 1100


async def test_a_noisy_taxel_line_costs_frames_and_counts_each(operator: Operator) -> None:
    await operator.reach(State.IDLE)
    if not operator.taxels.connected:
        await operator.taxels.connect()
    operator.clear_record()
    operator.faults.corrupt_bytes(TAXELS, "to_host", 0.001)
    operator.faults.drop_bytes(TAXELS, "to_host", 0.001)
    await operator.watch(1.0)
    operator.faults.corrupt_bytes(TAXELS, "to_host", 0.0)
    operator.faults.drop_bytes(TAXELS, "to_host", 0.0)
    await operator.watch(0.1)
    lost = sum(gap.count for block in operator.blocks for gap in block.gaps)
    counters = operator.counters
    assert lost > 10
    assert int(counters[-1] - counters[0]) + 1 == len(counters) + lost


async def test_a_missed_heartbeat_gives_way_to_an_emergency_stop(operator: Operator) -> None:
    """A run clears a missed heartbeat by itself, so that must not hide what came meanwhile."""
    await operator.reach(State.HOLD)
    await operator.until(lambda now: now.state == State.FAULT_OFF, LIFT_LIMIT_S, beat=False)
    assert operator.fault == Fault.HEARTBEAT
    operator.faults.press_estop()
    await asyncio.sleep(0.05)
    operator.faults.release_estop()
    await asyncio.sleep(0.05)
    assert (await operator.poll()).fault == Fault.ESTOP
    await operator.watch(0.5, beat=False)
    assert operator.fault == Fault.ESTOP
