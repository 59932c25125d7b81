"""The simulated operator: how fast, where and how hard a person moves the finger.

Nobody has published an operator's speeds or forces, so all numbers are plausible ones. A person is
imprecise in three ways: each session, each scan, and within a scan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.protocol.finger import MARKS_MM, PLATE_MM, VelocityProfile

TICK_S = 1e-3
LIFTED_MS = 200
"""Time in the air before and after a slide."""
RUN_UP_MM = 30.0
"""Distance in contact before the first mark and behind the last one."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class OperatorParameters:
    """How a person moves; spreads are those of the logarithm, relative to the mean.

    Speeds are means between the marks. ``speed_*_spread`` and ``force_*_spread`` vary from session
    to session, from scan to scan, and within a scan with a correlation time. ``tilt_*_mm``: height
    difference of neighbouring taxels, from attachment to attachment and from scan to scan.
    ``attachment_spread``: change of each taxel's gain with each attachment.
    """

    slow_mm_s: float = 60.0
    medium_mm_s: float = 100.0
    fast_mm_s: float = 160.0
    speed_session_spread: float = 0.05
    speed_scan_spread: float = 0.12
    speed_wander_spread: float = 0.10
    speed_wander_s: float = 0.3
    force_g: float = 400.0
    force_session_spread: float = 0.10
    force_scan_spread: float = 0.15
    force_wander_spread: float = 0.12
    force_wander_s: float = 0.4
    tilt_session_mm: float = 0.05
    tilt_scan_mm: float = 0.02
    attachment_spread: float = 0.08
    lateral_wander_mm: float = 1.5


class Slide(NamedTuple):
    """One movement over a plate, one value a millisecond: position along and across the plate in
    mm, float64 (n,) each, and contact force in g, float64 (n,), 0 in the air.
    """

    along_mm: _Floats
    across_mm: _Floats
    force_g: _Floats


class Habits(NamedTuple):
    """What stays the same within a session: relative speed and force, and the attachment's tilt."""

    speed: float
    force: float
    tilt_along_mm: float
    tilt_across_mm: float


def draw_session(parameters: OperatorParameters, random: np.random.Generator) -> Habits:
    """Return the habits and the attachment of one session."""
    p = parameters
    speed, force, along, across = random.standard_normal(4)
    return Habits(
        float(np.exp(p.speed_session_spread * speed)),
        float(np.exp(p.force_session_spread * force)),
        p.tilt_session_mm * float(along),
        p.tilt_session_mm * float(across),
    )


def draw_slide(
    parameters: OperatorParameters,
    session: Habits,
    profile: VelocityProfile,
    random: np.random.Generator,
) -> Slide:
    """Return one slide over the plate in a velocity profile."""
    p = parameters
    factor = session.speed * float(np.exp(p.speed_scan_spread * random.standard_normal()))
    longest = round(1000.0 * PLATE_MM / (0.3 * min(_ends(p, profile))))
    speed_wander = _wander(longest, p.speed_wander_spread, p.speed_wander_s, random)
    along_mm = _move(p, profile, factor * np.exp(speed_wander))
    n = len(along_mm)
    scan_force = float(np.exp(p.force_scan_spread * random.standard_normal()))
    level = p.force_g * session.force * scan_force
    wander = _wander(n, p.force_wander_spread, p.force_wander_s, random)
    across_mm = p.lateral_wander_mm * _wander(n, 1.0, 1.0, random)
    slide = Slide(along_mm, across_mm, level * np.exp(wander) * _touch(n))
    return _with_air(slide)


def _ends(p: OperatorParameters, profile: VelocityProfile) -> tuple[float, float]:
    """Return the speeds at the first and at the last mark, mm/s."""
    constant = {
        VelocityProfile.SLOW: p.slow_mm_s,
        VelocityProfile.MEDIUM: p.medium_mm_s,
        VelocityProfile.FAST: p.fast_mm_s,
    }
    if profile in constant:
        return constant[profile], constant[profile]
    ends = p.slow_mm_s, p.fast_mm_s
    return ends if profile is VelocityProfile.SLOW_TO_FAST else ends[::-1]


def _move(p: OperatorParameters, profile: VelocityProfile, factors: _Floats) -> _Floats:
    """Return positions from the run-up to the end, mm; the speed follows the position."""
    first, last = MARKS_MM
    begin, end = _ends(p, profile)
    position, positions = first - RUN_UP_MM, []
    for factor in factors:
        share = min(max((position - first) / (last - first), 0.0), 1.0)
        position += (begin + (end - begin) * share) * factor * TICK_S
        if position >= last + RUN_UP_MM:
            break
        positions.append(position)
    return np.array(positions)


def _wander(n: int, spread: float, correlation_s: float, random: np.random.Generator) -> _Floats:
    """Return slow fluctuations of a standard deviation, float64 (n,): a low-passed noise."""
    keep = float(np.exp(-TICK_S / correlation_s))
    noise = random.standard_normal(n) * np.sqrt(1.0 - keep * keep)
    value, values = random.standard_normal(), np.empty(n)
    for i in range(n):
        value = keep * value + noise[i]
        values[i] = value
    return spread * values


def _touch(n: int) -> _Floats:
    """Return the share of the force while the finger comes down and lifts, 0 to 1."""
    ramp = np.minimum(np.arange(n), np.arange(n)[::-1]) / 80.0
    return np.minimum(ramp, 1.0)


def _with_air(slide: Slide) -> Slide:
    """Return the slide with the time in the air at both ends."""
    air = (LIFTED_MS, LIFTED_MS)
    return Slide(
        np.pad(slide.along_mm, air, mode="edge"),
        np.pad(slide.across_mm, air, mode="edge"),
        np.pad(slide.force_g, air),
    )
