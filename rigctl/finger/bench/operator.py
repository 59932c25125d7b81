"""The simulated operator: how fast, where and how hard a person moves the finger.

A person has habits for a session, and draws anew for every slide. All draws of a slide come from
one generator, so they depend on its seed alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from rigctl.bench.contact import Mounting
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.values import MARKS_MM, PLATE_MM, VelocityProfile

_STEP_S = 0.02
_REACH = 4.0


def wander(n: int, correlation_s: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Return a stationary Gaussian process of unit variance, one value a millisecond, float64 (n,).

    Its correlation falls to exp(-1/4) in ``correlation_s``: white noise under a Gaussian window.
    Unlike a first-order process it has a finite rate of change, as a moving limb has.
    """
    sigma = correlation_s / _STEP_S
    margin = int(np.ceil(_REACH * sigma))
    points = int(n * 1e-3 / _STEP_S) + 2
    noise = random.standard_normal(points + 2 * margin)
    smooth = gaussian_filter1d(noise, sigma, truncate=_REACH)[margin : margin + points]
    smooth *= np.sqrt(2.0 * np.sqrt(np.pi) * sigma)
    values: NDArray[np.float64] = np.interp(
        np.arange(n) * 1e-3, np.arange(points) * _STEP_S, smooth
    )
    return values


ALONG, ACROSS, HEIGHT, FORCE, WRIST_ALONG, WRIST_ACROSS, WRIST_HEIGHT = range(7)
"""Columns of a movement: the fingertip on the plate in mm (across from the middle, height over the
plate), contact force in g, and the deviation of the wrist from its place behind the finger in mm.
"""
N_COLUMNS = 7
TAXEL_PITCH_MM = 5.0
EDGE_MM = 10.0
"""Distance that a person keeps from the plate's ends: half a sensor and a margin."""

SLOWEST = 0.3
"""Share of the intended speed below which no slide falls."""

_MIDDLE_MM = PLATE_MM / 2.0
_Floats = NDArray[np.float64]


class Habits(NamedTuple):
    """What stays the same within a session: relative speed and force, the path, the sensor's
    attachment (tilts and turn in degrees, shift in mm, gains float64 (18,)), relative conductance
    without load, and the grip of the wrist in mm, float64 (3,).
    """

    speed: float
    force: float
    lateral_mm: float
    skew_deg: float
    tilts_deg: _Floats
    turn_deg: float
    shift_mm: float
    gains: _Floats
    rest: float
    wrist_mm: _Floats


class Slide(NamedTuple):
    """One movement over a plate, a row a millisecond, and how the sensor lies on it.

    ``rows``: float64 (n, 7), see :data:`ALONG`. It begins in the air over the place where the
    finger comes down, and ends there. In rows ``down`` to ``up`` the finger is on the plate.
    """

    rows: _Floats
    down: int
    up: int
    mounting: Mounting


def draw_habits(p: OperatorParameters, random: np.random.Generator) -> Habits:
    """Return the habits and the attachment of one session."""
    speed, force, lateral, skew, turn, shift, rest, drift = random.standard_normal(8)
    gains = np.exp(
        p.gain_drift_spread * drift
        + p.attachment_spread * random.standard_normal(PAPER_ARRAY.count)
    )
    return Habits(
        speed=math.exp(p.speed_session_spread * speed),
        force=math.exp(p.force_session_spread * force),
        lateral_mm=p.lateral_session_mm * float(lateral),
        skew_deg=p.skew_session_deg * float(skew),
        tilts_deg=p.tilt_attachment_deg * random.standard_normal(2),
        turn_deg=p.turn_attachment_deg * float(turn),
        shift_mm=p.shift_attachment_mm * float(shift),
        gains=gains,
        rest=math.exp(p.rest_drift_spread * rest),
        wrist_mm=p.wrist_session_mm * random.standard_normal(3),
    )


def draw_slide(
    p: OperatorParameters, habits: Habits, profile: VelocityProfile, random: np.random.Generator
) -> Slide:
    """Return one slide over the plate in a velocity profile."""
    skew_deg = habits.skew_deg + p.skew_scan_deg * float(random.standard_normal())
    mounting = _mounting(p, habits, skew_deg, random)
    along_mm = _along(p, habits, profile, random)
    rows = np.zeros((len(along_mm), N_COLUMNS))
    rows[:, ALONG] = along_mm
    rows[:, ACROSS] = _across(p, habits, along_mm, skew_deg, random)
    rows[:, FORCE] = _force(p, habits, len(along_mm), random)
    rows[:, WRIST_ALONG:] = _wrist(p, habits, along_mm, random)
    before, after = lower(p, rows[0]), lift(p, rows[-1])
    back = carry(after[-1], before[0], p.return_s)
    whole = np.concatenate([before, rows, after, back])
    return Slide(whole, len(before), len(before) + len(rows), mounting)


def lower(p: OperatorParameters, first: _Floats) -> _Floats:
    """Return rows in which the finger comes down in the place of a row, float64 (n, 7)."""
    return lift(p, first, p.lower_s)[::-1]


def lift(p: OperatorParameters, last: _Floats, seconds: float | None = None) -> _Floats:
    """Return rows in which the finger leaves the plate in the place of a row, float64 (n, 7)."""
    n = round(1000 * (p.lift_s if seconds is None else seconds))
    rows = np.tile(last, (n, 1))
    rows[:, FORCE] = 0.0
    rows[:, HEIGHT] = last[HEIGHT] + (p.air_mm - last[HEIGHT]) * smooth_step(n)
    return rows


def carry(begin: _Floats, end: _Floats, seconds: float) -> _Floats:
    """Return rows in which the hand moves through the air between two rows, float64 (n, 7)."""
    share = smooth_step(round(1000 * seconds))[:, None]
    return begin + (end - begin) * share


def smooth_step(n: int) -> _Floats:
    """Return 0 to 1 in n steps, at rest at both ends (minimum jerk), float64 (n,)."""
    t = np.arange(1, n + 1, dtype=np.float64) / n
    step: _Floats = t**3 * (10.0 + t * (6.0 * t - 15.0))
    return step


def intended_speeds(p: OperatorParameters, profile: VelocityProfile) -> tuple[float, float]:
    """Return the speeds that a profile asks for near the first and the last mark, mm/s."""
    constant = {
        VelocityProfile.SLOW: p.slow_mm_s,
        VelocityProfile.MEDIUM: p.medium_mm_s,
        VelocityProfile.FAST: p.fast_mm_s,
    }
    if profile in constant:
        return constant[profile], constant[profile]
    ends = p.slow_mm_s, p.fast_mm_s
    return ends if profile is VelocityProfile.SLOW_TO_FAST else (ends[1], ends[0])


def _mounting(
    p: OperatorParameters, habits: Habits, skew_deg: float, random: np.random.Generator
) -> Mounting:
    tilts_deg = habits.tilts_deg + p.tilt_scan_deg * random.standard_normal(2)
    along_mm, across_mm = TAXEL_PITCH_MM * np.tan(np.radians(tilts_deg))
    shift_mm = habits.shift_mm + p.seating_mm * float(random.standard_normal())
    turn_deg = habits.turn_deg + skew_deg + p.turn_scan_deg * float(random.standard_normal())
    return Mounting(float(along_mm), float(across_mm), shift_mm, habits.gains, turn_deg)


def _along(
    p: OperatorParameters, habits: Habits, profile: VelocityProfile, random: np.random.Generator
) -> _Floats:
    """Return the positions from touch to lift, mm; the intended speed follows the position."""
    before, after = np.abs(p.run_up_mm + p.run_up_scatter_mm * random.standard_normal(2))
    begin_mm = max(MARKS_MM[0] - float(before), EDGE_MM)
    end_mm = min(MARKS_MM[1] + float(after), PLATE_MM - EDGE_MM)
    factors = habits.speed * np.exp(p.speed_scan_spread * random.standard_normal(2))
    first, last = np.array(intended_speeds(p, profile)) * factors
    if profile in (VelocityProfile.SLOW, VelocityProfile.MEDIUM, VelocityProfile.FAST):
        last = first
    middle_mm = _MIDDLE_MM + p.change_place_mm * float(random.standard_normal())
    places = np.arange(int(PLATE_MM) + 1)
    share = np.clip((places - middle_mm) / p.change_mm + 0.5, 0.0, 1.0)
    speeds = first + (last - first) * share * share * (3.0 - 2.0 * share)
    longest = round(1000.0 * PLATE_MM / (SLOWEST * float(min(first, last))))
    wandering = np.exp(p.speed_wander_spread * wander(longest, p.speed_wander_s, random))
    path = _integrate(begin_mm, end_mm, speeds.tolist(), np.maximum(wandering, SLOWEST).tolist())
    return _with_soft_ends(np.array(path), round(1000.0 * p.acceleration_s))


def _integrate(
    begin_mm: float, end_mm: float, speeds: list[float], factors: list[float]
) -> list[float]:
    position, positions = begin_mm, []
    for factor in factors:
        positions.append(position)
        position += speeds[int(position)] * factor * 1e-3
        if position >= end_mm:
            break
    return positions


def _with_soft_ends(positions: _Floats, ramp_ms: int) -> _Floats:
    """Return the same path that starts from rest and ends at rest: its ends take twice as long."""
    ramp_ms = min(ramp_ms, len(positions) // 3)
    rising = (np.arange(2 * ramp_ms) + 1.0) / (2 * ramp_ms)
    rate = np.concatenate([rising, np.ones(len(positions) - 2 * ramp_ms), rising[::-1]])
    at = np.cumsum(rate) - rate[0]
    at *= (len(positions) - 1.0) / at[-1]
    soft: _Floats = np.interp(at, np.arange(len(positions)), positions)
    return soft


def _across(
    p: OperatorParameters,
    habits: Habits,
    along_mm: _Floats,
    skew_deg: float,
    random: np.random.Generator,
) -> _Floats:
    lateral_mm = habits.lateral_mm + p.lateral_scan_mm * float(random.standard_normal())
    wandering = p.lateral_wander_mm * wander(len(along_mm), p.lateral_wander_s, random)
    straight = lateral_mm + math.tan(math.radians(skew_deg)) * (along_mm - _MIDDLE_MM)
    across: _Floats = straight + wandering
    return across


def _force(p: OperatorParameters, habits: Habits, n: int, random: np.random.Generator) -> _Floats:
    level = p.force_scan_spread * float(random.standard_normal())
    wandering = p.force_wander_spread * wander(n, p.force_wander_s, random)
    ramp_ms = min(round(1000.0 * p.touch_s), n // 3)
    touch = np.ones(n)
    touch[:ramp_ms], touch[n - ramp_ms :] = smooth_step(ramp_ms), smooth_step(ramp_ms)[::-1]
    force: _Floats = p.force_g * habits.force * np.exp(level + wandering) * touch
    return force


def _wrist(
    p: OperatorParameters, habits: Habits, along_mm: _Floats, random: np.random.Generator
) -> _Floats:
    """Return how the wrist deviates from its place behind the finger, mm, float64 (n, 3)."""
    grip_mm = habits.wrist_mm + p.wrist_scan_mm * random.standard_normal(3)
    bend_mm = p.wrist_bend_mm * random.standard_normal(3)
    share = (along_mm - _MIDDLE_MM) / (MARKS_MM[1] - MARKS_MM[0])
    n = len(along_mm)
    wandering = np.stack([wander(n, p.wrist_wander_s, random) for _ in range(3)], axis=1)
    deviation: _Floats = grip_mm + share[:, None] * bend_mm + p.wrist_wander_mm * wandering
    return deviation
