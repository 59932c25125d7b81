"""A header adapts the image to another drum, driver, actuator and amplifier."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from rigctl.bench.chips.simavr import Input, Output, ResetBy
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import Fault, State
from tests.benchmarks.firmware._drum_timing import run
from tests.firmware.drum.support.checks import open_emergency_stop
from tests.firmware.drum.support.other_drum import SELFTEST_MS, STEP_MM, OtherDrum


def start_over(drum: OtherDrum) -> None:
    """Clear an emergency stop, then arm, home and tare again."""
    drum.pin(Input.ESTOP, 0)
    drum.run(3)
    assert drum.command(Command.CLEAR) == 0
    drum.prepare()


@pytest.fixture(scope="module")
def tuned() -> Iterator[OtherDrum]:
    """Yield a drum in ARMED with the gains that it proposed."""
    with OtherDrum() as drum:
        drum.tune()
        yield drum


def test_it_reports_its_geometry_and_finds_the_index_at_the_expected_step(tuned: OtherDrum) -> None:
    assert tuned.get("steps_per_turn") == 6400
    assert tuned.get("nm_per_step") == 56_250
    before = tuned.x.drum_steps - tuned.get("steps")
    tuned.set("move_target", tuned.get("steps") + 3 * 6400)
    marks = tuned.get("index_count")
    assert tuned.command(Command.MOVE, 30_000) == 0
    assert tuned.get("index_count") == marks + 3
    assert tuned.get("index_error_steps") == 0
    assert tuned.x.drum_steps - tuned.get("steps") == before
    assert tuned.get("actuator_position_um") == pytest.approx(1000 * tuned.rod_mm, abs=80)


@pytest.mark.parametrize(("speed_mm_s", "force_g"), [(40, 250), (120, 1000)])
def test_the_force_is_within_its_limits(tuned: OtherDrum, speed_mm_s: float, force_g: int) -> None:
    trial = tuned.trial(speed_mm_s, force_g)
    assert trial.settle_s < 2.0  # 0.6 s with 80 samples a second
    assert trial.overshoot < 0.05
    assert abs(trial.mean_error) < 0.01


def test_a_run_has_exact_steps_and_pulse_times(tuned: OtherDrum) -> None:
    tuned.hold(500)
    for speed_mm_s in (40, 73.7, 120):
        result = run(tuned, speed_mm_s, STEP_MM)
        assert result.jitter <= 6
        assert result.rate_ppm < 5
        assert result.steps_off == 0
    assert tuned.x.loadcell_conversions - tuned.x.loadcell_reads <= 1
    assert tuned.command(Command.RETRACT, 5000) == 0


@pytest.mark.parametrize("state", [State.ARMED, State.HOLD, State.RUN])
def test_the_emergency_stop_acts_within_100_microseconds(tuned: OtherDrum, state: State) -> None:
    if state is not State.ARMED:
        tuned.hold(500)
    if state is State.RUN:
        assert tuned.command(Command.RUN) == 0
        tuned.poll_for(600)
    assert tuned.state is state
    open_emergency_stop(tuned, 5000)
    assert tuned.get("fault") == Fault.ESTOP
    start_over(tuned)


def test_its_lower_end_switch_has_the_pin_of_the_header(tuned: OtherDrum) -> None:
    assert tuned.command(Command.APPROACH) == 0
    tuned.poll_for(300)
    tuned.pin(Input.END_UP, 1)  # the pin that is the upper end in the default variant
    tuned.run(3)
    assert tuned.get("fault") == Fault.ACTUATOR_END
    tuned.pin(Input.END_UP, 0)
    tuned.poll_for(800)
    assert tuned.command(Command.CLEAR) == 0
    tuned.prepare()


def test_its_force_limit_is_that_of_the_header(tuned: OtherDrum) -> None:
    assert tuned.get("most_force") == 1500
    before = tuned.get("over_force")
    assert tuned.set("over_force", 30_000) == 0
    assert tuned.set("force_set", 14_000) == 0
    assert tuned.command(Command.APPROACH) == 4  # a tenth more would be above the limit
    assert tuned.set("over_force", before) == 0


def test_its_driver_is_off_until_it_is_armed() -> None:
    with OtherDrum() as drum:
        drum.clear_edges()
        drum.chip.reset(ResetBy.PIN)
        drum.run(SELFTEST_MS)
        assert drum.state is State.IDLE
        assert np.all(drum.edges(Output.ENABLE)[:, 1] == 1)
        assert drum.steps().size == 0
        drum.arm()
        assert drum.edges(Output.ENABLE)[-1, 1] == 0
