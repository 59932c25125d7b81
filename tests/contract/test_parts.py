"""Force modes, gain proposal, tare over a turn, optional wires, saved settings: both boards."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

import numpy as np
import pytest

from rigctl.errors import CommandRefused
from rigctl.simulation.simulated_rig import DRUM
from rigctl.wire.drum.codes import Command, CommandResult, ForceMode, SettingsFrom, Signal, Status
from rigctl.wire.drum.states import Fault, State
from rigctl.wire.drum.tare_table import PLACE_NAMES
from rigctl.wire.taxels.frames import Flag
from tests.contract.operator import Operator

ALL = sum(1 << signal for signal in Signal)
QUICK = {
    "force_set": 300.0,
    "speed_set": 80.0,
    "run_in_set": 30.0,
    "travel_set": 40.0,
    "force_mode": 0.0,
    "over_force": 1400.0,
}


@pytest.fixture(autouse=True)
def sound_bench(at_rig: Operator) -> None:
    """Every test begins with all wires fitted, the right way round, and a new record."""
    at_rig.faults.release_estop()
    at_rig.run(rewired(at_rig))
    at_rig.forget()


async def rewired(
    at_rig: Operator, absent: Iterable[Signal] = (), inverted: Iterable[Signal] = ()
) -> None:
    """The bench wired so and the board told; lifted off and switched off before.

    The emergency stop comes last: a board that sees it open takes no such setting.
    """
    absent, inverted = tuple(absent), tuple(inverted)
    await at_rig.drum.poll()
    if at_rig.state not in (State.IDLE, State.FAULT_OFF):
        await at_rig.reach(State.IDLE)
    told = await at_rig.drum.get("optional_signals", "signal_polarity")
    others = [signal for signal in Signal if signal is not Signal.ESTOP]
    missing = [] if int(told["optional_signals"]) & 1 else [Signal.ESTOP]
    turned = [Signal.ESTOP] if int(told["signal_polarity"]) & 1 else []
    at_rig.faults.rewire(
        missing + [signal for signal in others if signal in absent],
        turned + [signal for signal in others if signal in inverted],
    )
    await at_rig.drum.set(
        **QUICK,
        optional_signals=ALL - sum(1 << signal for signal in absent),
        signal_polarity=sum(1 << signal for signal in inverted),
        clock_trim_ppm=at_rig.clocks_ppm["drum"],
    )
    at_rig.faults.rewire(absent, inverted)
    await at_rig.watch(0.1)
    if at_rig.fault is not Fault.NONE:
        await at_rig.do(Command.CLEAR)
    if not at_rig.states[-1].status_bits >> Status.TARED & 1:
        await at_rig.reach(State.ARMED)
        await at_rig.do(Command.TARE)


async def press_and_turn(at_rig: Operator) -> None:
    """From wherever it is, through one contact and back to ARMED."""
    await at_rig.reach(State.HOLD)
    await at_rig.do(Command.RUN)
    await at_rig.do(Command.RETRACT)
    assert (at_rig.state, at_rig.fault) == (State.ARMED, Fault.NONE)
    assert at_rig.simulation.truth.arrays().force_g[-1] == 0.0


async def refused(at_rig: Operator, *commands: Command) -> None:
    for command in commands:
        with pytest.raises(CommandRefused):
            await at_rig.drum.command(command)


def test_a_step_test_proposes_gains_and_the_force_comes_back(at_rig: Operator) -> None:
    async def main() -> dict[str, float]:
        await at_rig.reach(State.ARMED)
        await refused(at_rig, Command.TUNE)
        await at_rig.reach(State.HOLD)
        await at_rig.do(Command.TUNE)
        await at_rig.watch(1.5)
        return await at_rig.drum.get(
            "proposed_gain_p", "proposed_gain_i", "tuned_stiffness_g_per_mm", "tuned_delay"
        )

    found = at_rig.run(main())
    assert 4 < found["proposed_gain_p"] < 12
    delay_s = found["tuned_delay"] * 1e-3
    assert found["proposed_gain_i"] == pytest.approx(0.0125 / delay_s**2, rel=0.01)
    assert 25 < found["tuned_delay"] < 75
    assert 350 < found["tuned_stiffness_g_per_mm"] < 1000
    assert at_rig.state is State.HOLD
    force_g = at_rig.simulation.truth.arrays().force_g
    assert force_g.max() < 330
    assert force_g[-200:].mean() == pytest.approx(300, rel=0.02)


def test_proposed_gains_can_be_set_and_hold(at_rig: Operator) -> None:
    async def main() -> None:
        before = await at_rig.drum.get("gain_p", "gain_i")
        await at_rig.reach(State.HOLD)
        await at_rig.do(Command.TUNE)
        found = await at_rig.drum.get("proposed_gain_p", "proposed_gain_i")
        await at_rig.drum.set(gain_p=found["proposed_gain_p"], gain_i=found["proposed_gain_i"])
        await press_and_turn(at_rig)
        await at_rig.drum.set(**before)

    at_rig.run(main())


def test_a_lock_rests_the_actuator_while_the_drum_turns(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.drum.set(force_mode=ForceMode.LOCK)
        await at_rig.reach(State.HOLD)
        await at_rig.watch(0.2)
        at_rig.forget()
        await at_rig.do(Command.RUN)

    at_rig.run(main())
    assert all(state.actuator_drive_permille == 0 for state in at_rig.states)


def test_a_depth_is_reached_and_kept_while_the_drum_turns(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.drum.set(force_mode=ForceMode.POSITION, depth_set_um=600)
        await at_rig.reach(State.HOLD)
        at_rig.forget()
        await at_rig.do(Command.RUN)

    at_rig.run(main())
    contact_um = at_rig.states[-1].values["last_contact_um"]
    depths = [state.actuator_position_um - contact_um for state in at_rig.states]
    assert min(depths) > 500
    assert max(depths) < 700


def test_a_tare_over_a_turn_takes_the_imbalance_out(at_rig: Operator) -> None:
    async def main() -> list[float]:
        await at_rig.reach(State.ARMED)
        await refused(at_rig, Command.TARE_TURN)
        await at_rig.do(Command.HOME)
        await at_rig.do(Command.TARE_TURN, 40.0)
        means = []
        for place in (0, 3200, 6400, 9600):
            await at_rig.drum.set(move_target=float(place + 25_600))
            await at_rig.do(Command.MOVE)
            await at_rig.watch(0.4)
            at_rig.forget()
            await at_rig.watch(0.6)
            means.append(np.mean([x.force_g for s in at_rig.states for x in s.loadcell]))
        return means

    means = at_rig.run(main())
    table = [at_rig.drum.settings[name] for name in PLACE_NAMES]
    # One gram once a turn, 2.4 mg a count.
    assert 300 < (max(table) - min(table)) / 2 < 550
    assert abs(sum(table)) < 20
    assert max(abs(mean) for mean in means) < 0.5
    assert at_rig.states[-1].status_bits >> Status.TARED & 1
    at_rig.run(at_rig.drum.set(**dict.fromkeys(PLACE_NAMES, 0.0)))


def test_a_run_in_without_room_for_settling_is_refused(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.drum.set(speed_set=120.0, run_in_set=20.0)
        await at_rig.reach(State.HOLD)
        await refused(at_rig, Command.RUN)
        await at_rig.drum.set(run_settle_ms=50)
        await at_rig.do(Command.RUN)
        await at_rig.drum.set(run_settle_ms=100)

    at_rig.run(main())


@pytest.mark.parametrize("absent", list(Signal), ids=lambda signal: signal.name)
def test_each_optional_wire_may_be_missing(at_rig: Operator, absent: Signal) -> None:
    async def main() -> None:
        await rewired(at_rig, absent=[absent])
        if absent is Signal.ESTOP:
            at_rig.faults.press_estop()
        await at_rig.reach(State.ARMED)
        if absent is Signal.INDEX:
            await refused(at_rig, Command.HOME)
        runs = at_rig.states[-1].sync_count
        await press_and_turn(at_rig)
        assert at_rig.states[-1].sync_count == runs + 1

    at_rig.run(main())
    seen = bool(np.any(at_rig.flags & np.uint8(Flag.SYNC)))
    assert seen is (absent is not Signal.SYNC)
    if absent is Signal.POSITION:
        assert at_rig.states[-1].status_bits >> Status.END_UP & 1


def test_every_optional_wire_may_be_inverted(at_rig: Operator) -> None:
    async def main() -> None:
        await rewired(at_rig, inverted=list(Signal))
        at_rig.forget()
        await at_rig.reach(State.ARMED)
        await at_rig.do(Command.HOME)
        await press_and_turn(at_rig)
        at_rig.faults.press_estop()
        await at_rig.watch(0.1)
        assert (at_rig.state, at_rig.fault) == (State.FAULT_OFF, Fault.ESTOP)
        at_rig.faults.release_estop()
        await at_rig.watch(0.1)
        await at_rig.do(Command.CLEAR)

    at_rig.run(main())
    rows = np.flatnonzero(at_rig.flags & np.uint8(Flag.SYNC))
    assert abs(len(rows) - 500) <= 2
    np.testing.assert_array_equal(np.diff(rows), 1)


def test_an_inverted_emergency_stop_that_nobody_told_of_is_a_fault(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.drum.poll()
        at_rig.faults.rewire(inverted=[Signal.ESTOP])
        await at_rig.watch(0.1)
        assert at_rig.fault is Fault.ESTOP
        await refused(at_rig, Command.CLEAR)
        with pytest.raises(CommandRefused, match="signal_polarity not set: lift the drum"):
            await at_rig.drum.set(signal_polarity=1)
        at_rig.faults.press_estop()  # it closes: the board may be told what it is
        await at_rig.watch(0.1)
        await at_rig.do(Command.CLEAR)
        await at_rig.drum.set(signal_polarity=1)
        await at_rig.watch(0.1)
        await refused(at_rig, Command.CLEAR)
        at_rig.faults.release_estop()
        await at_rig.watch(0.1)
        await at_rig.do(Command.CLEAR)

    at_rig.run(main())


def test_saving_takes_a_byte_a_tick_and_power_lost_meanwhile_leaves_the_old(
    at_rig: Operator,
) -> None:
    async def save(seconds: float) -> float:
        await at_rig.drum.command(Command.SAVE)
        begun_s = at_rig.now_s
        await at_rig.until(lambda s: s.values["command_result"] == CommandResult.DONE, seconds)
        return at_rig.now_s - begun_s

    async def main() -> None:
        await at_rig.reach(State.IDLE)
        await at_rig.drum.set(gain_p=6.5)
        assert 0.08 < await save(1.0) < 0.2
        await at_rig.drum.set(gain_p=9.5)
        await at_rig.drum.command(Command.SAVE)
        await asyncio.sleep(0.03)
        at_rig.faults.reset(DRUM)
        await at_rig.lost(at_rig.drum.poll)
        await at_rig.drum.connect()
        await at_rig.until_state(State.IDLE)
        assert (await at_rig.drum.get("gain_p"))["gain_p"] == pytest.approx(6.5)
        await at_rig.do(Command.DEFAULTS)

    at_rig.run(main())


def test_saved_settings_outlive_a_reset_and_others_do_not(at_rig: Operator) -> None:
    async def main() -> None:
        await at_rig.reach(State.IDLE)
        await at_rig.drum.set(gain_p=5.5, force_set=321.0, scale_ug_per_count=2399)
        await at_rig.do(Command.SAVE)
        await at_rig.drum.set(gain_p=9.0)
        at_rig.faults.reset(DRUM)
        await at_rig.lost(at_rig.drum.poll)
        await at_rig.drum.connect()
        await at_rig.until_state(State.IDLE)
        kept = await at_rig.drum.get("gain_p", "force_set", "scale_ug_per_count", "settings_from")
        assert kept == pytest.approx(
            {
                "gain_p": 5.5,
                "force_set": 321.0,
                "scale_ug_per_count": 2399,
                "settings_from": SettingsFrom.SAVED,
            }
        )
        await at_rig.do(Command.DEFAULTS)
        assert (await at_rig.drum.get("gain_p"))["gain_p"] == pytest.approx(6.0)
        assert at_rig.states[-1].values["command_result"] == CommandResult.DONE

    at_rig.run(main())
