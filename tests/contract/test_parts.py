"""Force modes, gain proposal, tare over a turn, optional wires, saved settings: both boards."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable

import numpy as np
import pytest

from rigctl.bench.simulated_rig import DRUM
from rigctl.boards.drum_codes import Command, CommandResult, ForceMode, SettingsFrom, Signal, Status
from rigctl.boards.drum_poll import PLACE_NAMES
from rigctl.boards.drum_states import Fault, State
from rigctl.boards.taxel_frames import Flag
from rigctl.errors import CommandRefused
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
def sound_bench(operator: Operator) -> None:
    """Start every test with all wires fitted and not inverted, and a new record."""
    operator.faults.release_estop()
    operator.run(rewired(operator))
    operator.clear_record()


async def rewired(
    operator: Operator, absent: Iterable[Signal] = (), inverted: Iterable[Signal] = ()
) -> None:
    """Lift and switch off, then change the wires of the bench and the board's settings.

    The emergency stop is rewired last, because a board refuses these settings while it is open.
    """
    absent, inverted = tuple(absent), tuple(inverted)
    await operator.poll()
    if operator.state not in (State.IDLE, State.FAULT_OFF):
        await operator.reach(State.IDLE)
    settings = await operator.drum.get("optional_signals", "signal_polarity")
    others = [signal for signal in Signal if signal is not Signal.ESTOP]
    missing = [] if int(settings["optional_signals"]) & 1 else [Signal.ESTOP]
    turned = [Signal.ESTOP] if int(settings["signal_polarity"]) & 1 else []
    operator.faults.rewire(
        missing + [signal for signal in others if signal in absent],
        turned + [signal for signal in others if signal in inverted],
    )
    await operator.drum.set(
        **QUICK,
        optional_signals=ALL - sum(1 << signal for signal in absent),
        signal_polarity=sum(1 << signal for signal in inverted),
        clock_trim_ppm=operator.clocks_ppm["drum"],
    )
    operator.faults.rewire(absent, inverted)
    await operator.watch(0.1)
    if operator.fault is not Fault.NONE:
        await operator.do(Command.CLEAR)
    if not operator.states[-1].status_bits >> Status.TARED & 1:
        await operator.reach(State.ARMED)
        await operator.do(Command.TARE)


async def press_and_turn(operator: Operator) -> None:
    """Go from any state through one contact and back to ARMED."""
    await operator.reach(State.HOLD)
    await operator.do(Command.RUN)
    await operator.do(Command.RETRACT)
    assert (operator.state, operator.fault) == (State.ARMED, Fault.NONE)
    assert operator.simulation.truth.arrays().force_g[-1] == 0.0


async def refused(operator: Operator, *commands: Command) -> None:
    for command in commands:
        with pytest.raises(CommandRefused):
            await operator.drum.command(command)


def test_a_step_test_proposes_gains_and_restores_the_force(operator: Operator) -> None:
    async def main() -> dict[str, float]:
        await operator.reach(State.ARMED)
        await refused(operator, Command.TUNE)
        await operator.reach(State.HOLD)
        await operator.do(Command.TUNE)
        await operator.watch(1.5)
        return await operator.drum.get(
            "proposed_gain_p", "proposed_gain_i", "tuned_stiffness_g_per_mm", "tuned_delay"
        )

    found = operator.run(main())
    assert 4 < found["proposed_gain_p"] < 12
    delay_s = found["tuned_delay"] * 1e-3
    assert found["proposed_gain_i"] == pytest.approx(0.0125 / delay_s**2, rel=0.01)
    assert 25 < found["tuned_delay"] < 75
    assert 350 < found["tuned_stiffness_g_per_mm"] < 1000
    assert operator.state is State.HOLD
    force_g = operator.simulation.truth.arrays().force_g
    assert force_g.max() < 330
    assert force_g[-200:].mean() == pytest.approx(300, rel=0.02)


async def test_proposed_gains_can_be_set_and_hold(operator: Operator) -> None:
    before = await operator.drum.get("gain_p", "gain_i")
    await operator.reach(State.HOLD)
    await operator.do(Command.TUNE)
    found = await operator.drum.get("proposed_gain_p", "proposed_gain_i")
    await operator.drum.set(gain_p=found["proposed_gain_p"], gain_i=found["proposed_gain_i"])
    await press_and_turn(operator)
    await operator.drum.set(**before)


async def test_a_lock_rests_the_actuator_while_the_drum_turns(operator: Operator) -> None:
    await operator.drum.set(force_mode=ForceMode.LOCK)
    await operator.reach(State.HOLD)
    await operator.watch(0.2)
    operator.clear_record()
    await operator.do(Command.RUN)
    assert all(state.actuator_drive_permille == 0 for state in operator.states)


async def test_a_depth_is_reached_and_kept_while_the_drum_turns(operator: Operator) -> None:
    await operator.drum.set(force_mode=ForceMode.POSITION, depth_set_um=600)
    await operator.reach(State.HOLD)
    operator.clear_record()
    await operator.do(Command.RUN)
    contact_um = operator.states[-1].values["last_contact_um"]
    depths = [state.actuator_position_um - contact_um for state in operator.states]
    assert min(depths) > 500
    assert max(depths) < 700


def test_a_tare_over_a_turn_removes_the_imbalance(operator: Operator) -> None:
    async def main() -> list[float]:
        await operator.reach(State.ARMED)
        await refused(operator, Command.TARE_TURN)
        await operator.do(Command.HOME)
        await operator.do(Command.TARE_TURN, 40.0)
        means = []
        for place in (0, 3200, 6400, 9600):
            await operator.drum.set(move_target=float(place + 25_600))
            await operator.do(Command.MOVE)
            await operator.watch(0.4)
            operator.clear_record()
            await operator.watch(0.6)
            means.append(np.mean([x.force_g for s in operator.states for x in s.loadcell]))
        return means

    means = operator.run(main())
    table = [operator.drum.settings[name] for name in PLACE_NAMES]
    # One gram once a turn, 2.4 mg a count.
    assert 300 < (max(table) - min(table)) / 2 < 550
    assert abs(sum(table)) < 20
    assert max(abs(mean) for mean in means) < 0.5
    assert operator.states[-1].status_bits >> Status.TARED & 1
    operator.run(operator.drum.set(**dict.fromkeys(PLACE_NAMES, 0.0)))


async def test_a_run_in_without_room_for_settling_is_refused(operator: Operator) -> None:
    await operator.drum.set(speed_set=120.0, run_in_set=20.0)
    await operator.reach(State.HOLD)
    await refused(operator, Command.RUN)
    await operator.drum.set(run_settle_ms=50)
    await operator.do(Command.RUN)
    await operator.drum.set(run_settle_ms=100)


@pytest.mark.parametrize("absent", list(Signal), ids=lambda signal: signal.name)
async def test_each_optional_wire_may_be_missing(operator: Operator, absent: Signal) -> None:
    await rewired(operator, absent=[absent])
    if absent is Signal.ESTOP:
        operator.faults.press_estop()
    await operator.reach(State.ARMED)
    if absent is Signal.INDEX:
        await refused(operator, Command.HOME)
    runs = operator.states[-1].sync_count
    await press_and_turn(operator)
    assert operator.states[-1].sync_count == runs + 1
    seen = bool(np.any(operator.flags & np.uint8(Flag.SYNC)))
    assert seen is (absent is not Signal.SYNC)
    if absent is Signal.POSITION:
        assert operator.states[-1].status_bits >> Status.END_UP & 1


async def test_every_optional_wire_may_be_inverted(operator: Operator) -> None:
    await rewired(operator, inverted=list(Signal))
    operator.clear_record()
    await operator.reach(State.ARMED)
    await operator.do(Command.HOME)
    await press_and_turn(operator)
    operator.faults.press_estop()
    await operator.watch(0.1)
    assert (operator.state, operator.fault) == (State.FAULT_OFF, Fault.ESTOP)
    operator.faults.release_estop()
    await operator.watch(0.1)
    await operator.do(Command.CLEAR)
    rows = np.flatnonzero(operator.flags & np.uint8(Flag.SYNC))
    assert abs(len(rows) - 500) <= 2
    np.testing.assert_array_equal(np.diff(rows), 1)


async def test_an_undeclared_inverted_emergency_stop_is_a_fault(operator: Operator) -> None:
    await operator.poll()
    operator.faults.rewire(inverted=[Signal.ESTOP])
    await operator.watch(0.1)
    assert operator.fault is Fault.ESTOP
    await refused(operator, Command.CLEAR)
    with pytest.raises(CommandRefused, match="signal_polarity not set: lift the drum"):
        await operator.drum.set(signal_polarity=1)
    operator.faults.press_estop()  # closes the inverted input, so that settings may change
    await operator.watch(0.1)
    await operator.do(Command.CLEAR)
    await operator.drum.set(signal_polarity=1)
    await operator.watch(0.1)
    await refused(operator, Command.CLEAR)
    operator.faults.release_estop()
    await operator.watch(0.1)
    await operator.do(Command.CLEAR)


def test_a_save_takes_a_byte_per_tick_and_power_loss_keeps_the_old_settings(
    operator: Operator,
) -> None:
    async def save(seconds: float) -> float:
        await operator.drum.command(Command.SAVE)
        begun_s = operator.now_s
        await operator.until(lambda s: s.values["command_result"] == CommandResult.DONE, seconds)
        return operator.now_s - begun_s

    async def main() -> None:
        await operator.reach(State.IDLE)
        await operator.drum.set(gain_p=6.5)
        assert 0.08 < await save(1.0) < 0.2
        await operator.drum.set(gain_p=9.5)
        await operator.drum.command(Command.SAVE)
        await asyncio.sleep(0.03)
        operator.faults.reset(DRUM)
        await operator.lost(operator.poll)
        await operator.drum.connect()
        await operator.until_state(State.IDLE)
        assert (await operator.drum.get("gain_p"))["gain_p"] == pytest.approx(6.5)
        await operator.do(Command.DEFAULTS)

    operator.run(main())


async def test_only_saved_settings_survive_a_reset(operator: Operator) -> None:
    await operator.reach(State.IDLE)
    await operator.drum.set(gain_p=5.5, force_set=321.0, scale_ug_per_count=2399)
    await operator.do(Command.SAVE)
    await operator.drum.set(gain_p=9.0)
    operator.faults.reset(DRUM)
    await operator.lost(operator.poll)
    await operator.drum.connect()
    await operator.until_state(State.IDLE)
    settings = await operator.drum.get("gain_p", "force_set", "scale_ug_per_count", "settings_from")
    assert settings == pytest.approx(
        {
            "gain_p": 5.5,
            "force_set": 321.0,
            "scale_ug_per_count": 2399,
            "settings_from": SettingsFrom.SAVED,
        }
    )
    await operator.do(Command.DEFAULTS)
    assert (await operator.drum.get("gain_p"))["gain_p"] == pytest.approx(6.0)
    assert operator.states[-1].values["command_result"] == CommandResult.DONE
