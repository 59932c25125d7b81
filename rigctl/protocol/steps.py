"""The steps of a plan and their durations.

The overheads are those of the nominal rig, rounded up; a run replaces them with measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from rigctl.boards.drum_registers import BY_NAME
from rigctl.config.rig_config import RigConfig
from rigctl.values import PlannedTrial

FIND_CONTACT_S = 0.9
"""From the command to contact, across the lift clearance."""
SETTLE_S = 0.35
"""From contact into the force band, where the settling time starts."""
LIFT_S = 0.5
"""From the end of the window; the drum stops meanwhile."""
POLL_S = 0.04
"""From the end of a turn in contact to the next one."""
RUN_SETTLE_S = 0.1
"""At constant speed within the run-in; the board's own default."""
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


def run_in_range_mm(speed_mm_s: float, config: RigConfig) -> tuple[float, float]:
    """Return the shortest run-in that the board takes, a ramp and a while, and the longest."""
    longest = BY_NAME["run_in_set"]
    return ramp_mm(speed_mm_s, config) + speed_mm_s * RUN_SETTLE_S, longest.high * longest.scale


def way_to_repeat_mm(
    travel_mm: float, speed_mm_s: float, config: RigConfig, *, back: bool
) -> float:
    """Return the texture travel from the end of a trial to the window of the next, in contact.

    The windows are those of lifted trials. The drum turns on over the joint, or ``back``.
    """
    drum = config.drum
    end_mm = drum.run_in_mm + travel_mm + drum.sync_margin_mm + ramp_mm(speed_mm_s, config)
    whole_mm = drum.plate_length_mm if back else end_mm
    beyond_mm = end_mm if back else drum.circumference_mm
    return drum.run_in_mm + beyond_mm - whole_mm


def rig_seconds(
    step: Step, config: RigConfig, settle_s: float, way_mm: float | None = None
) -> float:
    """Return the rig time of ``step``, without people; ``settle_s``: time in the force band.

    ``way_mm``: to the trial's window, where the drum is still in contact from the one before.
    """
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
        case RunTrial() if way_mm is not None:
            stop_s = step.trial.speed_mm_s / config.drum.acceleration_mm_s2
            return _window_seconds(step.trial, way_mm, config) + stop_s + POLL_S
        case RunTrial():
            return _trial_seconds(step.trial, config, settle_s)


def _turn_seconds(step: Turn, config: RigConfig) -> float:
    """Return the time of one more turn than ``step`` has: ramps are outside the timed turns."""
    ramp_s = step.speed_mm_s / config.drum.acceleration_mm_s2
    return COMMAND_S + (step.turns + 1) * config.drum.circumference_mm / step.speed_mm_s + ramp_s


def _trial_seconds(trial: PlannedTrial, config: RigConfig, settle_s: float) -> float:
    drum = config.drum
    press_s = FIND_CONTACT_S + SETTLE_S + settle_s
    turn_s = _window_seconds(trial, drum.run_in_mm, config)
    left_mm = (drum.circumference_mm - turned_mm(trial, config)) % drum.circumference_mm
    return COMMAND_S + press_s + turn_s + LIFT_S + _move_seconds(left_mm, config)


def _window_seconds(trial: PlannedTrial, way_mm: float, config: RigConfig) -> float:
    """Return the time from standstill until the window closes, ``way_mm`` before it opens."""
    drum, speed = config.drum, trial.speed_mm_s
    constant_mm = way_mm - ramp_mm(speed, config) + trial.travel_mm + drum.sync_margin_mm
    return speed / drum.acceleration_mm_s2 + constant_mm / speed


def _move_seconds(distance_mm: float, config: RigConfig) -> float:
    """Return the time of a lifted move from standstill to standstill."""
    rapid, acceleration = config.drum.rapid_mm_s, config.drum.acceleration_mm_s2
    if distance_mm < rapid**2 / acceleration:
        return 2 * sqrt(distance_mm / acceleration)
    return rapid / acceleration + distance_mm / rapid
