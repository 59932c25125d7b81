"""The simulated bridge drives the actuator with the duty that the firmware sets."""

from __future__ import annotations

import pytest

from rigctl.boards.drum_codes import Command
from tests.firmware.drum.support.plant_drum import PlantDrum

ONE_STEP = 0.05
"""Permille: a fifth of one count of the timer."""


def test_the_bench_gets_the_duty_that_the_firmware_sets() -> None:
    with PlantDrum() as drum:
        drum.prepare()
        assert drum.command(Command.APPROACH) == 0
        differences = []
        for _ in range(20):
            drum.poll_for(50)
            differences.append(drum.get("actuator_drive") - 1000 * drum.x.drive)
        # The register holds the newest duty; the bench gets the mean of a millisecond.
        assert min(map(abs, differences)) == pytest.approx(0, abs=ONE_STEP)
