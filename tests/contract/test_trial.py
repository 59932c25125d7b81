"""One trial on both kinds of boards, from power-up to lifted."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.boards.drum_codes import Command, Status
from rigctl.boards.drum_states import State
from rigctl.boards.taxel_frames import Flag
from rigctl.errors import CommandRefused
from rigctl.values import DrumState
from tests.contract.operator import Operator

SPEED_MM_S, FORCE_G, TRAVEL_MM, RUN_IN_MM = 80.0, 400.0, 120.0, 60.0
PLATE_START_MM = 10.0
MM_PER_STEP = 0.03125


@dataclass
class Trial:
    """The record of one trial with its ground truth."""

    states: list[DrumState]
    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]
    speed_mm_s: NDArray[np.float32]
    force_g: NDArray[np.float32]
    sync: NDArray[np.uint8]
    run_from: int
    refused: list[str]
    lost: int
    taxels_ppm: float

    @property
    def window(self) -> NDArray[np.intp]:
        """Return the milliseconds of world time in which sync was high."""
        return np.flatnonzero(self.sync)

    @property
    def sample_window(self) -> NDArray[np.intp]:
        """Return the rows of samples with sync high."""
        return np.flatnonzero(self.flags & Flag.SYNC)


async def perform(operator: Operator) -> Trial:
    """Arm, tare, home, move to the plate's start, approach, run, retract."""
    drum, refused = operator.drum, []
    operator.simulation.set_plate("G")
    await drum.set(
        speed_set=SPEED_MM_S,
        force_set=FORCE_G,
        travel_set=TRAVEL_MM,
        run_in_set=RUN_IN_MM,
        clock_trim_ppm=operator.clocks_ppm["drum"],
    )
    await operator.watch(0.2)
    for command in (Command.COMMISSION, Command.ARM, Command.TARE, Command.HOME):
        await operator.do(command)
    await drum.set(move_target=PLATE_START_MM / MM_PER_STEP)
    await operator.do(Command.MOVE)
    await operator.do(Command.APPROACH)
    for command in (Command.MOVE, Command.TARE, Command.HOME, Command.ARM, Command.CLEAR):
        try:
            await drum.command(command)
        except CommandRefused:
            refused.append(command.name)
    run_from = len(operator.states)
    await operator.do(Command.RUN)
    await operator.do(Command.RETRACT)
    await operator.watch(0.1)
    truth = operator.simulation.truth.arrays()
    return Trial(
        list(operator.states),
        operator.counters,
        operator.samples,
        operator.flags,
        operator.edges,
        truth.speed_mm_s,
        truth.force_g,
        truth.sync,
        run_from,
        refused,
        operator.taxels.counters.lost,
        operator.clocks_ppm["taxels"],
    )


@pytest.fixture(scope="module")
def trial(operator: Operator) -> Trial:
    """Run the trial once on each kind of rig."""
    operator.clear_record()
    return operator.run(perform(operator))


def visited(states: list[DrumState]) -> list[State]:
    """Return the states in order, without repeats."""
    seen = [State(s.state) for s in states]
    return [seen[0]] + [b for a, b in pairwise(seen) if a is not b]


def test_the_states_follow_the_table(trial: Trial) -> None:
    way = visited(trial.states)
    # Each of these states lasts longer than a poll's period, so no poll misses one.
    assert way[:2] == [State.IDLE, State.RETRACT]
    assert way[-6:] == [
        State.APPROACH,
        State.HOLD,
        State.RUN,
        State.HOLD,
        State.RETRACT,
        State.ARMED,
    ]
    assert all(s.fault == 0 for s in trial.states)


def test_home_finds_the_mark_and_move_reaches_the_step(trial: Trial) -> None:
    approach = next(s for s in trial.states if s.state == State.APPROACH)
    assert approach.status_bits >> Status.HOMED & 1
    assert approach.steps == PLATE_START_MM / MM_PER_STEP
    assert approach.angle_deg == pytest.approx(9.0, abs=0.02)


def test_after_the_tare_the_lifted_drum_has_zero_force(trial: Trial) -> None:
    before_contact = [s for s in trial.states[: trial.run_from] if s.state < State.APPROACH]
    tared = [s for s in before_contact if s.status_bits >> Status.TARED & 1]
    assert abs(np.mean([x.force_g for s in tared for x in s.loadcell])) < 1.0
    assert abs(tared[-1].force_g) < 3.0
    assert abs(trial.states[-1].force_g) < 5.0


def test_the_approach_reaches_the_force_without_overshoot(trial: Trial) -> None:
    hold = next(s for s in trial.states if s.state == State.HOLD)
    assert hold.status_bits >> Status.IN_CONTACT & 1
    assert hold.status_bits >> Status.FORCE_SETTLED & 1
    assert 19_000 < hold.values["last_contact_um"] < 21_000
    assert trial.force_g.max() < 1.1 * FORCE_G


def test_commands_that_contact_does_not_allow_are_refused(trial: Trial) -> None:
    assert trial.refused == ["MOVE", "TARE", "HOME", "ARM", "CLEAR"]


def test_force_and_speed_in_the_window_are_the_set_values(trial: Trial) -> None:
    force, speed = trial.force_g[trial.window], trial.speed_mm_s[trial.window]
    assert abs(force.mean() / FORCE_G - 1) < 0.02
    assert abs(speed[1:-1].mean() / SPEED_MM_S - 1) < 0.001
    assert np.abs(speed[1:-1] / SPEED_MM_S - 1).max() < 0.05


def test_sync_is_high_once_for_the_set_travel_after_the_run_in(trial: Trial) -> None:
    window = trial.window
    assert np.all(np.diff(window) == 1)
    travel_mm = trial.speed_mm_s[window].sum() * 1e-3
    assert travel_mm == pytest.approx(TRAVEL_MM, abs=2 * SPEED_MM_S * 1e-3)
    before = trial.speed_mm_s[: window[0]]
    start = np.flatnonzero(before == 0)[-1]
    run_in_mm = before[start:].sum() * 1e-3
    assert run_in_mm == pytest.approx(RUN_IN_MM, abs=2 * SPEED_MM_S * 1e-3)


def test_the_board_reports_the_window(trial: Trial) -> None:
    before, after = trial.states[trial.run_from - 1], trial.states[-1]
    assert after.sync_count == before.sync_count + 1
    duration_s = (after.sync_fall_us - after.sync_rise_us) * 1e-6
    assert duration_s == pytest.approx(len(trial.window) * 1e-3, abs=0.006)
    steps = after.steps - before.steps
    assert steps * MM_PER_STEP > RUN_IN_MM + TRAVEL_MM


def test_the_window_in_the_taxel_stream_is_exact_to_the_sample(trial: Trial) -> None:
    rows = trial.sample_window
    assert np.all(np.diff(rows) == 1)
    expected = TRAVEL_MM / SPEED_MM_S * 1000 * (1 + trial.taxels_ppm * 1e-6)
    assert abs(len(rows) - expected) <= 2
    rises = np.flatnonzero(np.diff(trial.edges & 3))
    assert len(rises) == 1
    assert abs(int(rises[0]) + 1 - int(rows[0])) <= 1


def test_every_index_mark_reaches_the_taxel_stream(trial: Trial) -> None:
    marks = np.diff((trial.edges >> 2).astype(np.int8)) % 4
    told_by_drum = trial.states[-1].index_count - trial.states[0].index_count
    assert told_by_drum >= 1
    assert int(marks.sum()) == told_by_drum
    assert np.count_nonzero(trial.flags & Flag.INDEX) == told_by_drum


def test_no_frame_is_lost_and_no_load_cell_sample(trial: Trial) -> None:
    np.testing.assert_array_equal(np.diff(trial.counters), 1)
    assert trial.lost == 0
    assert trial.states[-1].loadcell_lost == 0
    numbers = [x.sequence for s in trial.states for x in s.loadcell]
    np.testing.assert_array_equal(np.diff(numbers), 1)


def test_contact_raises_the_readings(trial: Trial) -> None:
    touched = trial.samples[trial.sample_window].mean(axis=0)
    lifted = trial.samples[-50:].mean(axis=0)
    assert (touched > lifted + 10).sum() >= 9
    assert (touched < lifted - 10).sum() == 0


def test_after_the_retract_the_drum_is_clear(trial: Trial) -> None:
    last = trial.states[-1]
    assert (last.speed_mm_s, last.actuator_drive_permille) == (0.0, 0)
    assert trial.force_g[-1] == 0
    clearance_um = last.values["last_contact_um"] - last.actuator_position_um
    assert 2900 < clearance_um < 3600


@pytest.mark.parametrize("end", ["start", "stop"])
def test_ramps_have_the_set_acceleration(trial: Trial, end: str) -> None:
    moving = np.flatnonzero(trial.speed_mm_s[trial.window[0] - 1000 : trial.window[-1] + 500])
    speed = trial.speed_mm_s[trial.window[0] - 1000 :][moving]
    ramp = speed[: np.argmax(speed >= 79)] if end == "start" else speed[::-1][:150]
    middle = ramp[(ramp > 20) & (ramp < 60)]
    assert abs(float(np.diff(middle[::5]).mean()) / 5 * 1000) == pytest.approx(600, rel=0.05)
