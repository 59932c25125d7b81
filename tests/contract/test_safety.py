"""What goes wrong on a bench, done to both kinds of boards; each leaves a safe drum."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.errors import BoardFault, BoardRebooted, CommandRefused, LinkLost
from rigctl.simulation.simulated_rig import DRUM, TAXELS
from rigctl.wire.drum.codes import Command, Status
from rigctl.wire.drum.states import Fault, State
from tests.contract.noise import bear_noise
from tests.contract.operator import Operator

QUICK = {"force_set": 300.0, "speed_set": 80.0, "run_in_set": 30.0, "travel_set": 245.0}
LIFT_LIMIT_S = 6.0


@pytest.fixture(autouse=True)
def sound_bench(at_rig: Operator) -> None:
    """Every test begins with a bench that nothing is wrong with, and a new record."""
    faults = at_rig.faults
    faults.release_estop()
    faults.push(0.0)
    for put_right in (faults.loadcell_silent, faults.loadcell_frozen, faults.loadcell_saturated):
        put_right(False)
    for board in (DRUM, TAXELS):
        faults.replug(board)
    at_rig.run(_settle(at_rig))
    at_rig.forget()


async def _settle(at_rig: Operator) -> None:
    if not at_rig.drum.connected:
        await at_rig.drum.connect()
    await at_rig.drum.set(**QUICK, clock_trim_ppm=at_rig.clocks_ppm["drum"])
    await at_rig.drum.poll(False)


async def faulted(at_rig: Operator, within_s: float = 0.5) -> float:
    """Poll every 5 ms until a fault is latched; seconds that took."""
    start_s = at_rig.now_s
    while not (await at_rig.drum.poll()).fault:
        assert at_rig.now_s - start_s < within_s, "no fault latched in time"
        await asyncio.sleep(0.005)
    return at_rig.now_s - start_s


def true_force_g(at_rig: Operator) -> float:
    return float(at_rig.simulation.truth.arrays().force_g[-1])


def true_speed_mm_s(at_rig: Operator) -> float:
    return float(at_rig.simulation.truth.arrays().speed_mm_s[-1])


async def lifted_then_off(at_rig: Operator, cause: Fault) -> None:
    """The fault lifts the drum, for a set time, and then switches everything off."""
    assert (at_rig.state, at_rig.fault) == (State.FAULT_LIFT, cause)
    off = await at_rig.until_state(State.FAULT_OFF, LIFT_LIMIT_S)
    assert off.fault == cause
    assert (off.speed_mm_s, off.actuator_drive_permille) == (0.0, 0)
    assert true_force_g(at_rig) == 0.0


@pytest.mark.parametrize("state", [State.ARMED, State.HOLD, State.RUN])
def test_an_emergency_stop_switches_everything_off(at_rig: Operator, state: State) -> None:
    async def main() -> None:
        await at_rig.reach(state)
        await at_rig.watch(0.1)
        at_rig.faults.press_estop()
        await asyncio.sleep(0.005)
        stopped = await at_rig.drum.poll()
        assert (stopped.state, stopped.fault) == (State.FAULT_OFF, Fault.ESTOP)
        assert (stopped.speed_mm_s, stopped.actuator_drive_permille) == (0.0, 0)
        assert not stopped.status_bits >> Status.ESTOP_CLOSED & 1
        assert not stopped.status_bits >> Status.SYNC_HIGH & 1
        steps = stopped.steps
        await at_rig.watch(0.1)
        assert at_rig.states[-1].steps == steps
        assert true_speed_mm_s(at_rig) == 0.0
        for command in (Command.CLEAR, Command.ARM):
            with pytest.raises(CommandRefused, match="emergency stop pressed"):
                await at_rig.drum.command(command)
        at_rig.faults.release_estop()
        await at_rig.watch(0.1)
        assert (at_rig.state, at_rig.fault) == (State.FAULT_OFF, Fault.ESTOP)
        await at_rig.do(Command.CLEAR)
        assert (at_rig.state, at_rig.fault) == (State.IDLE, Fault.NONE)

    at_rig.run(main())


def test_an_open_emergency_stop_forbids_to_arm(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.IDLE)
        at_rig.faults.press_estop()
        await at_rig.watch(0.1)
        with pytest.raises(CommandRefused):
            await at_rig.drum.command(Command.ARM)

    at_rig.run(main())


@pytest.mark.parametrize("state", [State.HOLD, State.RUN])
def test_too_much_force_lifts_at_once(at_rig: Operator, state: State) -> None:
    async def main() -> None:
        await at_rig.reach(state)
        at_rig.faults.push(1500.0)
        assert await faulted(at_rig) < 0.1
        at_rig.faults.push(0.0)
        await lifted_then_off(at_rig, Fault.OVER_FORCE)

    at_rig.run(main())


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
def test_a_load_cell_that_fails_lifts(
    at_rig: Operator, what: Fault, state: State, within_s: float
) -> None:
    async def main() -> None:
        await at_rig.reach(state)
        await at_rig.watch(0.2)
        break_it = getattr(at_rig.faults, what.name.lower())
        break_it(True)
        assert await faulted(at_rig, 1.0) < within_s
        assert at_rig.states[-1].fault_bits >> what & 1
        await lifted_then_off(at_rig, what)
        with pytest.raises(CommandRefused):
            await at_rig.drum.command(Command.CLEAR)
        break_it(False)
        await at_rig.watch(0.3)
        await at_rig.do(Command.CLEAR)

    at_rig.run(main())


def test_a_host_that_falls_silent_lets_the_drum_ramp_down_lift_and_switch_off(
    at_rig: Operator,
) -> None:
    async def main() -> None:
        await at_rig.reach(State.RUN)
        await at_rig.watch(0.2)
        await asyncio.sleep(0.2)
        assert (await at_rig.drum.poll()).fault == 0
        last_beat_s = at_rig.now_s
        state = await at_rig.until(lambda s: s.fault != 0, 1.0, beat=False)
        assert state.at_s - last_beat_s == pytest.approx(0.25, abs=0.06)
        assert (at_rig.state, at_rig.fault) == (State.FAULT_LIFT, Fault.HEARTBEAT)
        off = await at_rig.until(lambda s: s.state == State.FAULT_OFF, 2.0, beat=False)
        assert off.at_s - last_beat_s == pytest.approx(1.0, abs=0.1)
        assert (off.speed_mm_s, off.actuator_drive_permille) == (0.0, 0)
        assert true_force_g(at_rig) == 0.0

    at_rig.run(main())


def test_an_idle_drum_needs_no_heartbeat(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.IDLE)
        await at_rig.watch(1.2, beat=False)
        assert (at_rig.state, at_rig.fault) == (State.IDLE, Fault.NONE)

    at_rig.run(main())


def test_no_contact_within_the_travel_allowed_is_a_fault(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.ARMED)
        await at_rig.drum.set(approach_limit_um=1000)
        with pytest.raises(BoardFault, match="no contact within the set travel"):
            await at_rig.drum.command(Command.APPROACH, wait=True)
        await at_rig.drum.set(approach_limit_um=30000)
        await lifted_then_off(at_rig, Fault.NO_CONTACT)

    at_rig.run(main())


def test_a_stop_while_running_lifts_and_leaves_the_drum_armed(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.RUN)
        await at_rig.watch(0.3)
        await at_rig.drum.stop()
        assert State((await at_rig.drum.poll()).state) is State.RETRACT
        armed = await at_rig.until_state(State.ARMED)
        assert (armed.speed_mm_s, armed.fault) == (0.0, 0)
        assert not armed.status_bits >> Status.SYNC_HIGH & 1
        assert true_force_g(at_rig) == 0.0

    at_rig.run(main())


def test_a_pulled_drum_cable_is_seen_and_the_drum_lifts_by_itself(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.RUN)
        boots = at_rig.drum.identity.boot_count
        at_rig.faults.unplug(DRUM)
        assert await at_rig.lost(at_rig.drum.poll) < 0.3
        await asyncio.sleep(1.5)
        assert true_force_g(at_rig) == 0.0
        assert true_speed_mm_s(at_rig) == 0.0
        with pytest.raises(LinkLost, match="plug the board in"):
            await at_rig.drum.connect()
        at_rig.faults.replug(DRUM)
        await at_rig.drum.connect()
        assert (at_rig.drum.rebooted, at_rig.drum.identity.boot_count) == (False, boots)
        assert (await at_rig.drum.poll()).fault == Fault.HEARTBEAT

    at_rig.run(main())


def test_a_silent_drum_line_is_seen(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.drum.poll()
        at_rig.faults.stall(DRUM)
        seen_s = await at_rig.lost(at_rig.drum.poll)
        at_rig.faults.stall(DRUM, False)
        assert seen_s < 0.3
        await at_rig.drum.poll()

    at_rig.run(main())


def test_a_drum_board_that_restarts_is_noticed_and_comes_back_idle(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.HOLD)
        boots = at_rig.drum.identity.boot_count
        at_rig.faults.reset(DRUM)
        assert await at_rig.lost(at_rig.drum.poll) < 0.5
        await at_rig.drum.connect()
        assert at_rig.drum.rebooted
        assert at_rig.drum.identity.boot_count == boots + 1
        state = await at_rig.until_state(State.IDLE)
        assert (state.fault, state.actuator_drive_permille) == (0, 0)

    at_rig.run(main())


def test_a_noisy_drum_line_changes_nothing_but_the_counters(at_rig: Operator) -> None:
    at_rig.run(bear_noise(at_rig))


def test_a_command_whose_reply_is_lost_is_repeated_and_executed_once(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.HOLD)
        rises, timeouts = at_rig.states[-1].sync_count, at_rig.drum.modbus.timeouts
        at_rig.faults.drop_bytes(DRUM, "to_host", 1.0)
        at_rig.rig.loop.call_later(0.1, at_rig.faults.drop_bytes, DRUM, "to_host", 0.0)
        # A drum that took the second request for a new one would refuse it: it runs already.
        await at_rig.drum.command(Command.RUN)
        assert at_rig.drum.modbus.timeouts - timeouts == 2
        await at_rig.until_state(State.RUN)
        state = await at_rig.until_state(State.HOLD)
        await at_rig.watch(0.5)
        assert at_rig.state is State.HOLD
        assert state.sync_count == rises + 1

    at_rig.run(main())


def test_a_pulled_taxel_cable_is_seen_and_what_was_lost_is_counted(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.IDLE)
        await at_rig.watch(0.2)
        boots, lost = at_rig.taxels.identity.boot_count, at_rig.taxels.counters.lost
        at_rig.faults.unplug(TAXELS)
        last = int(at_rig.counters[-1])
        assert [type(fault) for fault in at_rig.taxel_faults] == [LinkLost]
        await at_rig.watch(1.0)
        at_rig.faults.replug(TAXELS)
        at_rig.blocks.clear()
        await at_rig.taxels.connect()
        await at_rig.watch(0.3)
        assert (at_rig.taxels.rebooted, at_rig.taxels.identity.boot_count) == (False, boots)
        (gap,) = [gap for block in at_rig.blocks for gap in block.gaps]
        assert (gap.first_counter, gap.count) == (last + 1, int(at_rig.counters[0]) - last - 1)
        assert at_rig.taxels.counters.lost == lost + gap.count
        assert 1000 < gap.count < 1400

    at_rig.run(main())


def test_a_silent_taxel_line_is_seen(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.watch(0.1)
        at_rig.faults.stall(TAXELS)
        stalled_s = at_rig.now_s
        await at_rig.until(lambda _: bool(at_rig.taxel_faults), 1.0)
        at_rig.faults.stall(TAXELS, False)
        assert at_rig.now_s - stalled_s < 0.35
        assert not at_rig.taxels.connected
        await at_rig.taxels.connect()

    at_rig.run(main())


def test_a_taxel_board_that_restarts_is_reported(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.watch(0.1)
        boots = at_rig.taxels.status.boot_count if at_rig.taxels.status else 0
        at_rig.faults.reset(TAXELS)
        await at_rig.watch(1.0)
        assert [type(fault) for fault in at_rig.taxel_faults] == [BoardRebooted]
        assert at_rig.taxels.status is not None
        assert at_rig.taxels.status.boot_count == boots + 1
        assert int(at_rig.counters[-1]) < 1100

    at_rig.run(main())


def test_a_noisy_taxel_line_costs_frames_and_counts_each(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.IDLE)
        if not at_rig.taxels.connected:
            await at_rig.taxels.connect()
        at_rig.forget()
        at_rig.faults.corrupt_bytes(TAXELS, "to_host", 0.001)
        at_rig.faults.drop_bytes(TAXELS, "to_host", 0.001)
        await at_rig.watch(1.0)
        at_rig.faults.corrupt_bytes(TAXELS, "to_host", 0.0)
        at_rig.faults.drop_bytes(TAXELS, "to_host", 0.0)
        await at_rig.watch(0.1)

    at_rig.run(main())
    lost = sum(gap.count for block in at_rig.blocks for gap in block.gaps)
    counters = at_rig.counters
    assert lost > 10
    assert int(counters[-1] - counters[0]) + 1 == len(counters) + lost
