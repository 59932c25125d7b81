"""The bridge's duty as the bench feels it is the one that the firmware asks for."""

from __future__ import annotations

import pytest

from rigctl.wire.drum.codes import Command
from tests.firmware.drum.support.plant_drum import PlantDrum

ONE_STEP = 0.05
"""Permille: a fifth of what one count of the timer is."""


def test_a_duty_is_what_the_firmware_asks_for() -> None:
    with PlantDrum() as drum:
        drum.ready()
        assert drum.command(Command.APPROACH) == 0
        apart = []
        for _ in range(20):
            drum.poll_for(50)
            apart.append(drum.get("actuator_drive") - 1000 * drum.x.drive)
        # The register is the newest duty, what the bench feels the mean of a millisecond.
        assert min(map(abs, apart)) == pytest.approx(0, abs=ONE_STEP)
