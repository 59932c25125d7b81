"""The usual times of measurements beside the speeds of the drum's own firmware."""

from __future__ import annotations

import pytest

from rigctl.bench.virtual_rig import open_virtual_rig
from rigctl.boards.drum_codes import Command, CommandResult
from rigctl.boards.drum_registers import BY_NAME
from rigctl.config.rig_config import DrumGeometry
from rigctl.engine.calibration import (
    HOMING_MM_S,
    LIFT_S,
    PRESS_S,
    TURN_MM_S,
    usual_duration_s,
)
from rigctl.engine.calibration_values import FORCE, IMBALANCE
from tests.bench.host import Host

TURN_S_TOLERANCE = 0.3
"""Two ramps of the turn, the board's untrimmed clock and the period of the polls."""


def test_the_speeds_and_the_turn_are_those_of_the_firmware() -> None:
    host = Host(open_virtual_rig(seed=3))
    host.armed()
    homing_mm_s, _ = _turn(host, Command.HOME)
    turn_mm_s, turn_s = _turn(host, Command.TARE_TURN)
    assert homing_mm_s == HOMING_MM_S
    assert turn_mm_s == TURN_MM_S
    drum = DrumGeometry()
    home_s = usual_duration_s(FORCE, drum) - PRESS_S
    assert home_s == pytest.approx(drum.circumference_mm / 2 / homing_mm_s)
    expected_s = usual_duration_s(IMBALANCE, drum) - LIFT_S - home_s
    assert turn_s == pytest.approx(expected_s, abs=TURN_S_TOLERANCE)


def _turn(host: Host, command: Command) -> tuple[float, float]:
    """Return the highest speed that the board reports during a command, and the time it takes."""
    host.command(command)
    begun_us = host.simulation.time_us
    speeds: list[int] = []

    def is_done(poll: dict[str, int]) -> bool:
        speeds.append(poll["speed"])
        return poll["command_result"] == CommandResult.DONE

    host.until(is_done)
    return round(max(speeds) * BY_NAME["speed"].scale, 2), (
        host.simulation.time_us - begun_us
    ) / 1e6
