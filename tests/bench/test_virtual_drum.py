"""The virtual drum from the host's side: moves, forces, faults, rejected commands."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.bench.mechanics import DRUM_MM
from rigctl.bench.virtual_rig import VirtualRig, open_virtual_rig
from rigctl.boards.drum_codes import Command, CommandResult, Status
from rigctl.boards.drum_registers import MAGIC
from rigctl.boards.drum_states import Fault, State
from tests.bench.host import Host, Refused

STEPS_PER_TURN = 12800
MM_PER_STEP = 0.03125


@pytest.fixture
def rig() -> VirtualRig:
    return open_virtual_rig(seed=3)


@pytest.fixture
def host(rig: VirtualRig) -> Host:
    return Host(rig)


def test_it_identifies_itself(host: Host) -> None:
    host.wait(100_000)
    assert host.get("magic") == MAGIC
    assert host.get("boot_count") == 1
    assert host.get("steps_per_turn") * host.get("nm_per_step") == 400_000_000


def test_arming_lifts_to_the_upper_end_and_tare_reads_zero(host: Host) -> None:
    host.armed()
    poll = host.poll()
    assert poll["status_bits"] >> Status.END_UP & 1
    assert poll["status_bits"] >> Status.TARED & 1
    assert abs(poll["force"]) < 30  # 3 g


def test_approach_holds_the_force_within_two_percent(rig: VirtualRig, host: Host) -> None:
    host.holding(250.0)
    rig.truth.take()
    host.attend(1_000_000)
    assert rig.truth.take().force_g.mean() == pytest.approx(250.0, rel=0.02)


@pytest.mark.parametrize("speed_mm_s", [40.0, 120.0])
def test_sync_is_high_for_exactly_the_travel_at_constant_speed(
    rig: VirtualRig, host: Host, speed_mm_s: float
) -> None:
    host.holding()
    host.put("clock_trim_ppm", 1200)
    host.put("speed_set", round(100 * speed_mm_s))
    rig.truth.take()
    host.command(Command.RUN)
    host.state(State.HOLD)
    truth = rig.truth.take()
    window = truth.sync == 1
    assert window.sum() == pytest.approx(1000 * 245 / speed_mm_s, abs=1)
    inside = truth.speed_mm_s[window]
    assert inside.mean() == pytest.approx(speed_mm_s, rel=1e-4)
    assert np.ptp(inside[1:-1]) < 0.01 * speed_mm_s
    assert np.count_nonzero(np.diff(truth.sync)) == 2


def test_sync_travel_is_a_whole_number_of_steps_by_the_boards_clock(host: Host) -> None:
    host.holding()
    host.command(Command.RUN)
    poll = host.state(State.HOLD)
    high_us = poll["sync_fall_us"] - poll["sync_rise_us"]
    assert high_us == pytest.approx(245 / 80 * 1e6, abs=2)
    assert poll["sync_count"] == 1


def test_run_ends_where_run_in_travel_and_ramp_end(host: Host) -> None:
    host.holding()
    host.command(Command.ZERO_STEPS)
    host.command(Command.RUN)
    steps = host.state(State.HOLD)["steps"]
    ramp_mm = 80.0**2 / (2 * 600)
    # The board believes its own clock, which is fast: the true ramp is longer by as much.
    assert steps * MM_PER_STEP == pytest.approx(100 + 245 + ramp_mm, abs=0.05)


def test_an_untrimmed_board_turns_fast_by_its_clock_error(rig: VirtualRig, host: Host) -> None:
    host.holding()
    rig.truth.take()
    host.command(Command.RUN)
    host.state(State.HOLD)
    truth = rig.truth.take()
    assert truth.speed_mm_s[truth.sync == 1].mean() == pytest.approx(80 * 1.0012, rel=2e-5)


def test_move_lands_on_the_step_and_home_zeroes_at_the_mark(rig: VirtualRig, host: Host) -> None:
    host.armed()
    host.command(Command.HOME)
    host.until(lambda poll: poll["command_result"] == CommandResult.DONE)
    host.put("move_target", 3200)
    host.command(Command.MOVE)
    poll = host.until(lambda poll: poll["command_result"] == CommandResult.DONE)
    assert poll["steps"] == 3200
    assert poll["angle"] == 9000
    assert poll["status_bits"] >> Status.HOMED & 1
    plant = rig._bench.plant
    place_mm = plant.log[plant.time_ms % len(plant.log), DRUM_MM]
    assert place_mm % 400 == pytest.approx(100.0, abs=0.04)


def test_a_move_after_an_interrupted_homing_passes_the_mark(host: Host) -> None:
    host.armed()
    host.command(Command.HOME)
    host.attend(300_000)
    host.command(Command.STOP)
    host.state(State.ARMED)
    host.attend(500_000)
    host.command(Command.ZERO_STEPS)
    host.put("move_target", 12_800)  # a turn: the mark is on the way
    host.command(Command.MOVE)
    poll = host.until(lambda poll: poll["command_result"] != CommandResult.RUNNING)
    assert (poll["command_result"], poll["steps"]) == (CommandResult.DONE, 12_800)
    assert not poll["status_bits"] >> Status.HOMED & 1


def test_backward_runs_count_down(host: Host) -> None:
    host.holding()
    host.command(Command.ZERO_STEPS)
    host.put("direction_set", 1)
    host.command(Command.RUN)
    assert host.state(State.HOLD)["steps"] < -305 / MM_PER_STEP


def test_retract_lifts_clear_of_the_last_contact(host: Host) -> None:
    host.holding()
    host.command(Command.RETRACT)
    poll = host.state(State.ARMED)
    assert poll["last_contact_um"] == pytest.approx(20_000, abs=500)
    assert poll["actuator_position_um"] <= poll["last_contact_um"] - 2_900


def test_stop_in_a_run_ramps_down_and_lifts(rig: VirtualRig, host: Host) -> None:
    host.holding()
    host.command(Command.RUN)
    host.until(lambda poll: poll["sync_count"] == 1)
    host.command(Command.STOP)
    poll = host.state(State.ARMED)
    assert poll["speed"] == 0
    assert not poll["status_bits"] >> Status.SYNC_HIGH & 1
    assert rig.truth.arrays().sync[-1] == 0


def test_lock_mode_holds_the_position_not_the_force(host: Host) -> None:
    host.armed()
    host.put("force_mode", 1)
    host.command(Command.APPROACH)
    host.state(State.HOLD)
    before = host.poll()["actuator_position_um"]
    host.put("force_set", 8000)
    assert host.attend(500_000)["actuator_position_um"] == pytest.approx(before, abs=50)


def test_position_mode_goes_to_a_depth(host: Host) -> None:
    host.armed()
    host.put("force_mode", 2)
    host.put("depth_set_um", 800)
    host.command(Command.APPROACH)
    poll = host.state(State.HOLD)
    depth_um = poll["actuator_position_um"] - poll["last_contact_um"]
    assert depth_um == pytest.approx(800, abs=120)


@pytest.mark.parametrize(
    ("fault", "wanted"),
    [
        ("silent", Fault.LOADCELL_SILENT),
        ("frozen", Fault.LOADCELL_FROZEN),
        ("saturated", Fault.LOADCELL_SATURATED),
    ],
)
def test_a_load_cell_fault_lifts_and_then_switches_off(
    rig: VirtualRig, host: Host, fault: str, wanted: Fault
) -> None:
    host.holding()
    getattr(rig.faults, f"loadcell_{fault}")(True)
    poll = host.state(State.FAULT_OFF, 2_000_000)
    assert poll["fault"] == wanted
    assert poll["actuator_position_um"] < poll["last_contact_um"] - 2_000
    with pytest.raises(Refused, match="exception 4"):
        host.command(Command.CLEAR)
    getattr(rig.faults, f"loadcell_{fault}")(False)
    host.attend(200_000)
    host.command(Command.CLEAR)
    assert host.state(State.IDLE)["fault"] == Fault.NONE


def test_over_force_lifts(rig: VirtualRig, host: Host) -> None:
    host.holding()
    rig.faults.push(1200.0)
    poll = host.until(lambda poll: poll["state"] == State.FAULT_LIFT, 200_000)
    assert poll["fault"] == Fault.OVER_FORCE


@pytest.mark.parametrize("state", [State.ARMED, State.HOLD, State.RUN])
def test_estop_stops_everything_immediately(rig: VirtualRig, host: Host, state: State) -> None:
    host.armed() if state is State.ARMED else host.holding()
    if state is State.RUN:
        host.command(Command.RUN)
        host.attend(1_000_000)
    rig.faults.press_estop()
    before = rig.time_us
    poll = host.poll()
    assert poll["state"] == State.FAULT_OFF
    assert poll["fault"] == Fault.ESTOP
    assert poll["actuator_drive"] == 0
    assert poll["speed"] == 0
    host.wait(100_000)
    truth = rig.truth.arrays()
    assert np.all(truth.speed_mm_s[before // 1000 + 1 :] == 0)
    with pytest.raises(Refused, match="exception 4"):
        host.command(Command.CLEAR)
    rig.faults.release_estop()
    host.wait(2000)  # the tick that ends the latched opening, and the one that reads it closed
    host.command(Command.CLEAR)
    assert host.poll()["state"] == State.IDLE


def test_estop_pressed_at_boot_refuses_arm(rig: VirtualRig, host: Host) -> None:
    rig.faults.press_estop()
    host.wait(200_000)
    assert host.poll()["state"] == State.FAULT_OFF
    with pytest.raises(Refused, match="exception 4"):
        host.command(Command.ARM)


def test_a_lost_heartbeat_ramps_down_lifts_and_is_off_within_a_second(
    rig: VirtualRig, host: Host
) -> None:
    host.holding()
    host.command(Command.RUN)
    host.attend(1_000_000)
    silent_since = rig.time_us
    host.wait(260_000)
    assert host.get("state") == State.FAULT_LIFT
    host.wait(silent_since + 1_000_000 - rig.time_us)
    assert host.get("state") == State.FAULT_OFF
    assert host.fault() is Fault.HEARTBEAT
    assert rig.truth.arrays().force_g[-1] == 0.0


def test_no_contact_within_the_travel_is_a_fault(host: Host) -> None:
    host.armed()
    host.put("approach_limit_um", 5000)
    host.command(Command.APPROACH)
    poll = host.until(lambda poll: poll["state"] == State.FAULT_LIFT)
    assert poll["fault"] == Fault.NO_CONTACT
    assert poll["command_result"] == CommandResult.FAILED


def test_a_force_that_does_not_settle_is_a_fault(host: Host) -> None:
    host.armed()
    host.put("settle_time_ms", 5000)
    host.put("approach_timeout_ms", 3000)
    host.command(Command.APPROACH)
    poll = host.until(lambda poll: poll["fault"] != Fault.NONE)
    assert poll["fault"] == Fault.FORCE_UNREACHED


def test_a_jammed_drum_is_found_by_the_index_mark(rig: VirtualRig, host: Host) -> None:
    host.armed()
    host.command(Command.HOME)
    host.until(lambda poll: poll["command_result"] == CommandResult.DONE)
    host.put("move_target", 2 * STEPS_PER_TURN)
    host.command(Command.MOVE)
    host.attend(500_000)
    rig.faults.jam_motor(True)
    host.wait(4_000)  # at 200 mm/s some 25 steps: the mark still comes in time to be measured
    rig.faults.jam_motor(False)
    poll = host.until(lambda poll: poll["fault"] != Fault.NONE)
    assert poll["fault"] == Fault.STEP_COUNT
    assert abs(host.get("index_error_steps")) > 4


def test_a_reset_clears_all_settings_that_were_not_saved(rig: VirtualRig, host: Host) -> None:
    host.armed()
    host.put("force_set", 3000)
    host.command(Command.SAVE)
    host.until(lambda poll: poll["command_result"] == CommandResult.DONE)
    host.put("speed_set", 10000)
    rig.faults.reset("drum")
    host.wait(200_000)
    assert host.get("boot_count") == 2
    assert host.get("reset_cause") == 2
    assert (host.get("force_set"), host.get("speed_set")) == (3000, 8000)
    assert host.get("state") == State.IDLE


def test_the_true_force_does_not_overshoot(rig: VirtualRig, host: Host) -> None:
    host.holding(1000.0)
    assert rig.truth.arrays().force_g.max() < 1100.0


def test_a_command_during_a_tare_abandons_it(host: Host) -> None:
    host.armed()
    before = host.get("tare_counts")
    host.command(Command.TARE)
    host.command(Command.APPROACH)
    host.state(State.HOLD)
    assert host.get("tare_counts") == before


def test_a_run_in_shorter_than_the_ramp_is_refused(host: Host) -> None:
    host.holding()
    host.put("run_in_set", 50)
    with pytest.raises(Refused, match="exception 4"):
        host.command(Command.RUN)
    assert host.poll()["state"] == State.HOLD


def test_home_without_an_index_sensor_is_refused(host: Host) -> None:
    host.armed()
    host.put("optional_signals", 0b1101)
    with pytest.raises(Refused, match="exception 4"):
        host.command(Command.HOME)


def test_homing_a_jammed_drum_fails(rig: VirtualRig, host: Host) -> None:
    host.armed()
    rig.faults.jam_motor(True)
    host.command(Command.HOME)
    poll = host.until(lambda poll: poll["command_result"] != CommandResult.RUNNING)
    assert poll["command_result"] == CommandResult.FAILED
