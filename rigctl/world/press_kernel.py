"""The bench between two events, compiled: mechanics, load cell and force loop in one kernel.

It is the twin of :mod:`loadcell`, :mod:`drum_force`, :mod:`drum_presser` and
:mod:`drum_actuator`, operation by operation, so that both give the same numbers to the bit.
A test holds them to it.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.world import drum_actuator, drum_force, plant
from rigctl.world.compiled import compiled, inlined
from rigctl.world.drum_actuator import END_MM, FULL_SPEED_MM_S, LEAST_SPEED_MM_S
from rigctl.world.drum_force import (
    BLIND_SAMPLES,
    CONTACT_G,
    DELAY_S,
    FORGETTING,
    LAG_S,
    MOST_DRIFT_MM_S,
    MOST_RUN_OUT_MM,
    PERIOD_S,
    SHARE_LEARNED,
    SHARE_SEEN,
    TURNING_RAD_S,
)
from rigctl.world.drum_loadcell import FROZEN_RUN
from rigctl.world.drum_presser import FAR_MM_S, MOST_MM_S, NEAR_MM, SEARCH_MM_S
from rigctl.world.loadcell import FULL_SCALE
from rigctl.world.plant import (
    FELT_G,
    FORCE,
    INDEX_HIGH,
    RING_MS,
    ROD,
    TIME_MS,
    Motion,
    pass_millisecond,
)

(
    NEXT_US,
    SINCE_ORIGIN,
    CREPT,
    EQUAL_RUN,
    NEWEST,
    FORCE_G,
    CONTACT_MM,
    SETTLED,
    OUTSIDE_US,
    DUTY,
    OWED,
    LOW_MM,
    HIGH_MM,
    TAKEN,
    SHOT_US,
    SHOTS,
    SINE,
    COSINE,
    STIFFNESS,
    IN_CONTACT,
    SAMPLES,
    FREE,
    LAST_G,
    COMMAND,
    SPEED,
    MOVED,
    SHOWN,
    PENDING,
    COMPRESSION,
    DRIFT,
    SUM_XX,
    SUM_XY,
    LAST_RATE,
    STATE_SIZE,
) = range(34)
"""What changes, float64; from SINE on the numbers of the force loop."""

(
    ORIGIN_US,
    PERIOD_US,
    AVERAGE_MS,
    CREEP_GAIN,
    CREEP,
    DRIFT_G,
    DRIFT_S,
    NOISE_G,
    OFFSET,
    CELL_UG,
    COUNTS_PER_MM,
    MM_PER_COUNT,
    ROD_END_MM,
    TURN_STEPS,
    STEP_MM,
    CLOCK,
    TARE,
    SCALE_UG,
    OVER_G,
    PRESSES,
    TARGET_G,
    GAIN_P,
    GAIN_I,
    BAND_G,
    SETTLE_MS,
    DEAD_BAND,
    ZERO_MM,
    FROM_US,
    TRAVEL_MM,
    SPEED_MM_S,
    ACCELERATION,
    GIVEN_SIZE,
) = range(32)
"""What stays as it is between two events, float64; the last four are the drum's motion."""

DONE, STOPPED, TOUCHED, SETTLED_NOW, DECLINED = 0, 1, 2, 4, 8
"""Why the kernel came back: bits, because a conversion may touch and settle at once."""

SHOT_EVERY_US = 100_000.0
"""Polls are so far apart."""

_DECAY = math.exp(-PERIOD_S / LAG_S)
_LATE = DELAY_S / PERIOD_S
_Floats = NDArray[np.float64]


@inlined
def _pairwise(log: _Floats, first: int, count: int) -> float:
    """Sum of what the load cell felt in ``count`` < 16 rows, in the order in which NumPy adds."""
    total = 0.0
    behind = 0
    if count >= 8:
        r = log[first : first + 8, FELT_G]
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]))
        behind = 8
    for k in range(behind, count):
        total += log[first + k, FELT_G]
    return total


@inlined
def _felt(log: _Floats, end_ms: int, count: int) -> float:
    end = end_ms % RING_MS + 1
    first = end - count
    if first >= 0:
        return _pairwise(log, first, count) / count
    return (_pairwise(log, first + RING_MS, -first) + _pairwise(log, 0, end)) / count


@inlined
def _weigh(s: _Floats, log: _Floats, m: _Floats, k: _Floats, noise: float) -> float:
    """Raw counts of the conversion that is due."""
    at_us = m[NEXT_US]
    m[CREPT] += k[CREEP_GAIN] * (s[FORCE] - m[CREPT])
    drift = math.sin(2.0 * math.pi * at_us * 1e-6 / k[DRIFT_S])
    slow_g = k[DRIFT_G] * drift + k[CREEP] * m[CREPT]
    felt_g = _felt(log, int(at_us) // 1000, int(k[AVERAGE_MS]))
    force_g = felt_g + slow_g + k[NOISE_G] * noise
    counts = np.rint(k[OFFSET] + force_g * 1e6 / k[CELL_UG])
    return float(max(-FULL_SCALE - 1.0, min(float(FULL_SCALE), counts)))


@inlined
def _within(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))


@inlined
def _run_out_rate(m: _Floats, angle: float, rate: float) -> float:
    if abs(rate) < TURNING_RAD_S:
        return 0.0
    return float(rate * (m[SINE] * math.cos(angle) - m[COSINE] * math.sin(angle)))


@inlined
def _advance_model(m: _Floats) -> None:
    before = m[MOVED]
    settling = (m[SPEED] - m[COMMAND]) * LAG_S * (1.0 - _DECAY)
    m[MOVED] = m[COMMAND] * PERIOD_S + settling
    m[SPEED] = m[COMMAND] + (m[SPEED] - m[COMMAND]) * _DECAY
    m[SHOWN] = (1.0 - _LATE) * m[MOVED] + _LATE * before
    m[PENDING] = _LATE * m[MOVED]


@inlined
def _learn_stiffness(m: _Floats) -> None:
    if m[SAMPLES] < 3 or abs(m[SHOWN]) < 0.004:
        return
    rise_g = m[FORCE_G] - m[LAST_G]
    m[SUM_XX] = FORGETTING * m[SUM_XX] + m[SHOWN] * m[SHOWN]
    m[SUM_XY] = FORGETTING * m[SUM_XY] + m[SHOWN] * rise_g
    m[STIFFNESS] = min(5000.0, max(50.0, m[SUM_XY] / m[SUM_XX]))


@inlined
def _observe(m: _Floats, angle: float, rate: float) -> float:
    seen_at = angle - rate * (DELAY_S + PERIOD_S / 2.0)
    surface = m[DRIFT] + _run_out_rate(m, seen_at, rate)
    m[COMPRESSION] += m[SHOWN] + surface * PERIOD_S
    surprise = m[FORCE_G] / m[STIFFNESS] - m[COMPRESSION]
    m[COMPRESSION] += SHARE_SEEN * surprise
    if abs(rate) > TURNING_RAD_S and rate == m[LAST_RATE]:
        share = SHARE_LEARNED * surprise / rate
        m[SINE] = _within(m[SINE] + share * math.cos(seen_at), MOST_RUN_OUT_MM)
        m[COSINE] = _within(m[COSINE] - share * math.sin(seen_at), MOST_RUN_OUT_MM)
    return float(surprise)


@inlined
def _hold(m: _Floats, k: _Floats, angle: float, rate: float) -> float:
    surprise = _observe(m, angle, rate)
    m[DRIFT] = _within(m[DRIFT] + k[GAIN_I] * surprise, MOST_DRIFT_MM_S)
    surface = m[DRIFT] + _run_out_rate(m, angle + rate * LAG_S, rate)
    now_mm = m[COMPRESSION] + m[PENDING] + surface * DELAY_S
    wanted_mm = k[TARGET_G] / m[STIFFNESS]
    return float(k[GAIN_P] * (wanted_mm - now_mm) - surface)


@inlined
def _look_for_contact(m: _Floats) -> None:
    rise_g = m[FORCE_G] - m[FREE]
    if m[SAMPLES] > BLIND_SAMPLES and rise_g > CONTACT_G:
        m[IN_CONTACT] = 1.0
        m[SAMPLES] = 0.0
        m[COMPRESSION] = rise_g / m[STIFFNESS]


@inlined
def _sample(m: _Floats, k: _Floats, limit: float, angle: float, rate: float) -> float:
    _advance_model(m)
    m[SAMPLES] += 1.0
    if m[IN_CONTACT] != 0.0:
        if abs(rate) < TURNING_RAD_S:
            _learn_stiffness(m)
        speed = _hold(m, k, angle, rate)
    else:
        _look_for_contact(m)
        speed = limit
    m[LAST_G] = m[FORCE_G]
    m[LAST_RATE] = rate
    return float(_within(speed, limit))


@inlined
def _ask(m: _Floats, k: _Floats, speed: float) -> None:
    m[OWED] += speed * PERIOD_S
    if abs(speed) < LEAST_SPEED_MM_S:
        pulse = abs(m[OWED]) >= LEAST_SPEED_MM_S * PERIOD_S
        speed = math.copysign(LEAST_SPEED_MM_S, m[OWED]) if pulse else 0.0
    duty = 0.0
    if speed != 0.0:
        m[OWED] = 0.0
        share = min(1.0, abs(speed) / FULL_SPEED_MM_S)
        duty = k[DEAD_BAND] + (1.0 - k[DEAD_BAND]) * share
    m[DUTY] = math.copysign(duty, speed)
    m[COMMAND] = speed


@inlined
def _step_loop(s: _Floats, m: _Floats, k: _Floats, now_us: float) -> None:
    """One step of the loop with the newest reading; what :meth:`Presser.step` does."""
    from_us, travel, speed, acceleration = k[FROM_US], k[TRAVEL_MM], k[SPEED_MM_S], k[ACCELERATION]
    t = (now_us - from_us) * 1e-6
    place_mm = travel + t * (speed + 0.5 * acceleration * t)
    steps = math.floor((place_mm - k[ZERO_MM]) / k[STEP_MM] + 1e-6)
    angle = 2.0 * math.pi * (steps % int(k[TURN_STEPS])) / k[TURN_STEPS]
    speed_mm_s = speed + acceleration * (now_us - from_us) * 1e-6
    rate = 2.0 * math.pi * speed_mm_s / (k[TURN_STEPS] * k[STEP_MM])
    position_mm = int(s[ROD] * k[COUNTS_PER_MM] + 0.5) * k[MM_PER_COUNT]
    touched = m[IN_CONTACT] != 0.0
    limit = MOST_MM_S
    if not touched:
        limit = FAR_MM_S if m[CONTACT_MM] - position_mm > NEAR_MM else SEARCH_MM_S
    asked = _sample(m, k, limit, angle, rate)
    if m[IN_CONTACT] != 0.0 and not touched:
        m[CONTACT_MM] = position_mm
        m[LOW_MM] = -1.0
        m[HIGH_MM] = k[ROD_END_MM] - END_MM
        m[OUTSIDE_US] = now_us
    _ask(m, k, asked)
    if m[IN_CONTACT] == 0.0 or abs(m[FORCE_G] - k[TARGET_G]) > k[BAND_G]:
        m[OUTSIDE_US] = now_us
    m[SETTLED] = 1e-3 * k[CLOCK] * (now_us - m[OUTSIDE_US]) >= k[SETTLE_MS]


@inlined
def _convert(s: _Floats, log: _Floats, m: _Floats, k: _Floats, noise: float) -> bool:
    """The conversion that is due; False, and nothing changed, where the board sees a fault."""
    crept = m[CREPT]
    raw = _weigh(s, log, m, k, noise)
    equal_run = m[EQUAL_RUN] + 1.0 if raw == m[NEWEST] else 0.0
    force_g = (raw - k[TARE]) * k[SCALE_UG] * 1e-6
    if abs(raw) >= FULL_SCALE - 1 or equal_run + 1.0 >= FROZEN_RUN or abs(force_g) > k[OVER_G]:
        m[CREPT] = crept
        return False
    m[EQUAL_RUN], m[NEWEST], m[FORCE_G] = equal_run, raw, force_g
    m[SINCE_ORIGIN] += 1.0
    m[NEXT_US] = math.floor(k[ORIGIN_US] + m[SINCE_ORIGIN] * k[PERIOD_US])
    return True


@inlined
def _shoot(s: _Floats, m: _Floats, shots: _Floats, taken: int) -> None:
    """Note what a poll would find now."""
    shot = shots[int(m[SHOTS])]
    shot[0] = m[SHOT_US]
    shot[1] = taken
    shot[2] = s[ROD]
    shot[3] = m[FORCE_G]
    shot[4] = m[DUTY]
    shot[5] = m[SETTLED]
    shot[6] = s[INDEX_HIGH]
    m[SHOTS] += 1.0
    m[SHOT_US] += SHOT_EVERY_US


def _source_digest() -> str:
    """Names the sources of what is compiled in, all but this file's."""
    texts = (Path(str(module.__file__)).read_bytes() for module in _SOURCES)
    return hashlib.sha256(b"".join(texts)).hexdigest()


_SOURCES = (plant, drum_force, drum_actuator)


def _kernel(digest: str) -> Callable[..., Any]:
    """The kernel. ``digest`` is in its key on disk, which would not notice the other files."""

    @compiled
    def run(
        s: _Floats,
        c: _Floats,
        log: _Floats,
        footprint: _Floats,
        m: _Floats,
        k: _Floats,
        noise: NDArray[np.float32],
        raws: NDArray[np.int64],
        times_us: NDArray[np.int64],
        shots: _Floats,
        last_us: int,
    ) -> int:
        if digest == "":
            return DECLINED
        motion = Motion(k[FROM_US], k[TRAVEL_MM], k[SPEED_MM_S], k[ACCELERATION])
        taken = 0
        while True:
            shot_us = m[SHOT_US]
            until_ms = int(min(m[NEXT_US], float(last_us), shot_us)) // 1000
            while s[TIME_MS] < until_ms:
                marked = pass_millisecond(s, c, log, footprint, motion, m[DUTY])
                if marked or s[ROD] <= m[LOW_MM] or s[ROD] >= m[HIGH_MM]:
                    m[TAKEN] = taken
                    return STOPPED
            at_us = m[NEXT_US]
            if shot_us < at_us and shot_us <= last_us:
                _shoot(s, m, shots, taken)
                continue
            if at_us > last_us:
                m[TAKEN] = taken
                return DONE
            if not _convert(s, log, m, k, noise[taken]):
                m[TAKEN] = taken
                return DECLINED
            raws[taken] = int(m[NEWEST])
            times_us[taken] = int(at_us)
            taken += 1
            if k[PRESSES] != 0.0:
                touched = m[IN_CONTACT]
                _step_loop(s, m, k, at_us)
                news = TOUCHED if m[IN_CONTACT] > touched else DONE
                news |= SETTLED_NOW if m[SETTLED] != 0.0 and k[PRESSES] == 2.0 else DONE
                if news:
                    m[TAKEN] = taken
                    return news

    return run


run = _kernel(_source_digest())
