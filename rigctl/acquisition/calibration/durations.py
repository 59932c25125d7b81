"""How long a measurement of a calibration usually takes, for those who wait for it."""

from __future__ import annotations

from rigctl.acquisition.calibration.calibration_values import FORCE, IMBALANCE, LOADCELL, WIRING
from rigctl.config.rig_config import DrumGeometry

HOMING_MM_S, TURN_MM_S = 60.0, 40.0
"""Speeds of the drum's firmware: to the index mark, and of the turn."""
PRESS_S = 14.0
"""To nudge, lift, tare, press, make the step, hold for a while and lift."""
LIFT_S = 3.0
READING_S = {LOADCELL: 2.1, WIRING: 1.7}


def usual_duration_s(part: str, drum: DrumGeometry) -> float:
    """Return the usual time of a measurement; the index mark is half a turn away on average."""
    home_s = drum.circumference_mm / 2 / HOMING_MM_S
    if part == FORCE:
        return PRESS_S + home_s
    if part == IMBALANCE:
        return LIFT_S + home_s + drum.circumference_mm * 17 / 16 / TURN_MM_S
    return READING_S[part]
