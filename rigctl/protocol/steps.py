"""The steps of a plan and their durations.

The overheads are those of the nominal rig, rounded up; a run replaces them with measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from rigctl.config.rig_config import RigConfig
from rigctl.values import PlannedTrial

FIND_CONTACT_S = 1.2
"""From the command to contact, across the lift clearance."""
SETTLE_S = 0.7
"""From contact into the force band, where the settling time starts."""
LIFT_S = 0.6
TARE_S = 1.0
COMMAND_S = 0.15
"""Set-points, read-back and acknowledgements of one trial."""
PLATE_CHANGE_S = 60.0
"""Time that a person needs to snap in a plate."""


@dataclass(frozen=True, slots=True)
class ChangePlate:
    """Mount the plate of ``texture``; ``prompt`` tells a person what to do."""

    texture: str
    prompt: str


@dataclass(frozen=True, slots=True)
class RunTrial:
    """Record one trial."""

    trial: PlannedTrial


@dataclass(frozen=True, slots=True)
class Tare:
    """Zero the load cell while the drum is lifted and still."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Wait with the drum lifted."""

    seconds: float


@dataclass(frozen=True, slots=True)
class ApproachOnly:
    """Press without motion: approach, hold the force, lift."""

    force_g: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Baseline:
    """Record without contact."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Message:
    """Show a text; ``wait`` pauses the run until a person acknowledges it."""

    text: str
    wait: bool = False


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn the lifted drum at constant speed for whole turns, timed by the index mark."""

    speed_mm_s: float
    turns: int


Step = ChangePlate | RunTrial | Tare | Rest | ApproachOnly | Baseline | Message | Turn


def ramp_mm(speed_mm_s: float, config: RigConfig) -> float:
    """Return the texture travel of a ramp between standstill and ``speed_mm_s``."""
    return speed_mm_s**2 / (2 * config.drum.acceleration_mm_s2)


def turned_mm(trial: PlannedTrial, config: RigConfig) -> float:
    """Return the texture travel of one trial, run-in and ramps included."""
    drum = config.drum
    return (
        drum.run_in_mm + trial.travel_mm + drum.sync_margin_mm + ramp_mm(trial.speed_mm_s, config)
    )


def rig_seconds(step: Step, config: RigConfig, settle_s: float) -> float:
    """Return the rig time of ``step``, without people; ``settle_s``: time in the force band."""
    match step:
        case ChangePlate() | Message():
            return 0.0
        case Tare():
            return TARE_S
        case Rest() | Baseline():
            return step.seconds
        case ApproachOnly():
            return FIND_CONTACT_S + SETTLE_S + settle_s + step.seconds + LIFT_S
        case Turn():
            return _turn_seconds(step, config)
        case RunTrial():
            return _trial_seconds(step.trial, config, settle_s)


def _turn_seconds(step: Turn, config: RigConfig) -> float:
    """Return the time of one more turn than ``step`` has: ramps are outside the timed turns."""
    ramp_s = step.speed_mm_s / config.drum.acceleration_mm_s2
    return COMMAND_S + (step.turns + 1) * config.drum.circumference_mm / step.speed_mm_s + ramp_s


def _trial_seconds(trial: PlannedTrial, config: RigConfig, settle_s: float) -> float:
    drum, speed = config.drum, trial.speed_mm_s
    ramp_s = speed / drum.acceleration_mm_s2
    constant_mm = drum.run_in_mm - ramp_mm(speed, config) + trial.travel_mm + drum.sync_margin_mm
    press_s = FIND_CONTACT_S + SETTLE_S + settle_s
    turn_s = 2 * ramp_s + constant_mm / speed
    left_mm = (drum.circumference_mm - turned_mm(trial, config)) % drum.circumference_mm
    return COMMAND_S + press_s + turn_s + LIFT_S + _move_seconds(left_mm, config)


def _move_seconds(distance_mm: float, config: RigConfig) -> float:
    """Return the time of a lifted move from standstill to standstill."""
    rapid, acceleration = config.drum.rapid_mm_s, config.drum.acceleration_mm_s2
    if distance_mm < rapid**2 / acceleration:
        return 2 * sqrt(distance_mm / acceleration)
    return rapid / acceleration + distance_mm / rapid
