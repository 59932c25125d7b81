"""The steps that a plan is made of, and how long each takes the rig.

The overheads are those of the nominal rig, rounded up; a run replaces them by what it measures.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from math import sqrt

from rigctl.config.rig_config import RigConfig
from rigctl.values import PlannedTrial

FIND_CONTACT_S = 1.2
"""From the command to contact, out of the lift clearance."""
SETTLE_S = 0.7
"""From contact into the force band, where the settling time begins."""
LIFT_S = 0.6
TARE_S = 1.0
COMMAND_S = 0.15
"""Set-points, read-back and acknowledgements of one trial."""
PLATE_CHANGE_S = 60.0
"""What a person needs to snap in a plate."""


@dataclass(frozen=True, slots=True)
class ChangePlate:
    """Mount the plate of ``texture``; ``prompt`` is what a person is asked to do."""

    texture: str
    prompt: str


@dataclass(frozen=True, slots=True)
class RunTrial:
    """Record one trial."""

    trial: PlannedTrial


@dataclass(frozen=True, slots=True)
class Tare:
    """Take the lifted, still load cell's reading as zero."""


@dataclass(frozen=True, slots=True)
class Rest:
    """Wait, lifted."""

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
    """Tell the person something; with ``wait`` the run goes on when it is acknowledged."""

    text: str
    wait: bool = False


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn the lifted drum at constant speed over whole turns, timed by the index mark."""

    speed_mm_s: float
    turns: int


Step = ChangePlate | RunTrial | Tare | Rest | ApproachOnly | Baseline | Message | Turn


def ramp_mm(speed_mm_s: float, config: RigConfig) -> float:
    """Texture travel of a ramp between standstill and ``speed_mm_s``."""
    return speed_mm_s**2 / (2 * config.drum.acceleration_mm_s2)


def turned_mm(trial: PlannedTrial, config: RigConfig) -> float:
    """Texture that passes the sensor in one trial, run-in and ramps included."""
    drum = config.drum
    return (
        drum.run_in_mm + trial.travel_mm + drum.sync_margin_mm + ramp_mm(trial.speed_mm_s, config)
    )


@singledispatch
def rig_seconds(step: Step, config: RigConfig, settle_s: float) -> float:
    """Time that ``step`` takes the rig, without people. ``settle_s``: time in the force band."""
    raise TypeError(f"no step of a plan: {step!r}")


@rig_seconds.register
def _(step: ChangePlate, config: RigConfig, settle_s: float) -> float:
    return 0.0


@rig_seconds.register
def _(step: Message, config: RigConfig, settle_s: float) -> float:
    return 0.0


@rig_seconds.register
def _(step: Tare, config: RigConfig, settle_s: float) -> float:
    return TARE_S


@rig_seconds.register
def _(step: Rest, config: RigConfig, settle_s: float) -> float:
    return step.seconds


@rig_seconds.register
def _(step: Baseline, config: RigConfig, settle_s: float) -> float:
    return step.seconds


@rig_seconds.register
def _(step: Turn, config: RigConfig, settle_s: float) -> float:
    """One turn more than asked for, so that ramps lie outside of what the mark times."""
    ramp_s = step.speed_mm_s / config.drum.acceleration_mm_s2
    return COMMAND_S + (step.turns + 1) * config.drum.circumference_mm / step.speed_mm_s + ramp_s


@rig_seconds.register
def _(step: ApproachOnly, config: RigConfig, settle_s: float) -> float:
    return FIND_CONTACT_S + SETTLE_S + settle_s + step.seconds + LIFT_S


@rig_seconds.register
def _(step: RunTrial, config: RigConfig, settle_s: float) -> float:
    trial, drum = step.trial, config.drum
    speed = trial.speed_mm_s
    ramp_s = speed / drum.acceleration_mm_s2
    constant_mm = drum.run_in_mm - ramp_mm(speed, config) + trial.travel_mm + drum.sync_margin_mm
    press_s = FIND_CONTACT_S + SETTLE_S + settle_s
    turn_s = 2 * ramp_s + constant_mm / speed
    left_mm = (drum.circumference_mm - turned_mm(trial, config)) % drum.circumference_mm
    return COMMAND_S + press_s + turn_s + LIFT_S + _move_seconds(left_mm, config)


def _move_seconds(distance_mm: float, config: RigConfig) -> float:
    """A lifted move that starts and ends at standstill."""
    rapid, acceleration = config.drum.rapid_mm_s, config.drum.acceleration_mm_s2
    if distance_mm < rapid**2 / acceleration:
        return 2 * sqrt(distance_mm / acceleration)
    return rapid / acceleration + distance_mm / rapid
