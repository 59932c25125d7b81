"""The force loop keeps the true force on its chip, on nominal and extreme plants."""

from __future__ import annotations

import pytest

from rigctl.bench.parameters import WorldParameters
from tests.firmware.drum.support.plant_drum import PlantDrum


@pytest.mark.parametrize(
    ("plant", "force_g"),
    [
        (WorldParameters(), 500),
        (WorldParameters(stiffness_g_mm=900, pressure_power=1.5, frame_share=0.8), 250),
        (WorldParameters(stiffness_g_mm=900, pressure_power=2.2, frame_share=0.5), 1000),
        (
            WorldParameters(stiffness_g_mm=300, frame_share=0.8, dead_band=0.2, actuator_lag_ms=50),
            1000,
        ),
    ],
    ids=["nominal", "stiff", "stiff and stiffening", "soft and sluggish"],
)
def test_the_force_is_within_its_limits(plant: WorldParameters, force_g: int) -> None:
    with PlantDrum(plant) as drum:
        drum.prepare()
        trial = drum.trial(120, force_g)
    assert trial.settle_s < 1.0
    assert trial.overshoot < 0.05
    assert abs(trial.mean_error) < 0.01


def test_ridges_that_pass_in_a_ramp_are_not_learnt_as_run_out() -> None:
    """The loop once learnt from the slow start and end of a trial, which disturbed the next one."""
    rippled = WorldParameters(
        base_height_mm=1.5,
        base_space_mm=6.0,
        bottom_blur_mm=1.0,
        edge_drop_mm=0.2,
        frame_share=0.5,
        pressure_power=2.1,
    )
    with PlantDrum(rippled, "C") as drum:
        drum.prepare()
        first, second = drum.trial(40, 250), drum.trial(60, 250)
    assert abs(first.mean_error) < 0.005
    assert abs(second.mean_error) < 0.005
