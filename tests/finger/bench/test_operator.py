"""The simulated person: speeds, places and forces of slides, and what sessions change."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from rigctl.finger.bench.operator import (
    ALONG,
    FORCE,
    HEIGHT,
    WRIST_ALONG,
    Habits,
    Slide,
    draw_habits,
    draw_slide,
    intended_speeds,
    wander,
)
from rigctl.finger.bench.operator_parameters import OperatorParameters
from rigctl.finger.values import MARKS_MM, VelocityProfile

P = OperatorParameters()
SLIDES = 40
PROFILES = list(VelocityProfile)


def _habits(session: int) -> Habits:
    return draw_habits(P, np.random.default_rng((1, session)))


def _slides(profile: VelocityProfile, session: int = 0) -> list[Slide]:
    habits = _habits(session)
    return [draw_slide(P, habits, profile, np.random.default_rng((2, n))) for n in range(SLIDES)]


def _halves(slide: Slide) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    along_mm = slide.rows[slide.down : slide.up, ALONG]
    at = [int(np.argmax(along_mm >= place)) for place in (MARKS_MM[0], 150.0, MARKS_MM[1])]
    return 100_000.0 / np.diff(at)


@pytest.mark.parametrize("profile", PROFILES)
def test_each_half_of_a_profile_has_its_speed(profile: VelocityProfile) -> None:
    halves = np.exp(np.mean(np.log([_halves(slide) for slide in _slides(profile)]), axis=0))
    first, last = intended_speeds(P, profile)
    speed = _habits(0).speed
    # A changing profile has left its first speed, and not reached its last, in some of each half.
    share = 1.0 if first == last else 0.75
    assert abs(np.log(halves[0] / (speed * first))) < abs(np.log(share)) + 0.08
    assert abs(np.log(halves[1] / (speed * last))) < abs(np.log(share)) + 0.08
    assert np.sign(np.log(halves[1] / halves[0]).round(1)) == np.sign(last - first)


def test_speeds_differ_from_scan_to_scan_as_stated() -> None:
    means = [200.0 / (100.0 / _halves(s)).sum() for s in _slides(VelocityProfile.MEDIUM)]
    assert 0.08 < np.std(np.log(means)) < 0.2


@pytest.mark.parametrize("profile", PROFILES)
def test_a_slide_passes_both_marks_in_contact_and_begins_and_ends_in_the_air(
    profile: VelocityProfile,
) -> None:
    for slide in _slides(profile):
        contact = slide.rows[slide.down : slide.up]
        assert 10.0 <= contact[0, ALONG] < MARKS_MM[0] - 5.0
        assert MARKS_MM[1] + 5.0 < contact[-1, ALONG] <= 290.0
        at_marks = np.searchsorted(contact[:, ALONG], MARKS_MM)
        assert (contact[at_marks, FORCE] > 0.3 * P.force_g).all()
        assert (contact[:, HEIGHT] == 0.0).all()
        for row in (slide.rows[0], slide.rows[-1]):
            assert row[HEIGHT] == pytest.approx(P.air_mm)
            assert row[FORCE] == 0.0
        assert slide.rows[-1, ALONG] == pytest.approx(slide.rows[0, ALONG])


def test_a_hand_moves_without_jumps() -> None:
    for profile in PROFILES:
        for slide in _slides(profile)[:10]:
            steps = np.abs(np.diff(slide.rows, axis=0))
            assert steps[:, ALONG].max() < 0.7, "mm a millisecond"
            assert steps[:, WRIST_ALONG:].max() < 0.1
            assert np.abs(np.diff(slide.rows[:, ALONG], 2)).max() < 0.3


def _spread(value: Callable[[Habits], float]) -> float:
    return float(np.std([value(_habits(session)) for session in range(200)]))


def test_sessions_differ_by_the_stated_spreads() -> None:
    assert _spread(lambda h: np.log(h.speed)) == pytest.approx(P.speed_session_spread, rel=0.2)
    assert _spread(lambda h: np.log(h.force)) == pytest.approx(P.force_session_spread, rel=0.2)
    assert _spread(lambda h: np.log(h.rest)) == pytest.approx(P.rest_drift_spread, rel=0.2)
    gains = np.hypot(P.gain_drift_spread, P.attachment_spread)
    assert _spread(lambda h: float(np.log(h.gains[0]))) == pytest.approx(gains, rel=0.2)
    assert _spread(lambda h: float(h.tilts_deg[0])) == pytest.approx(P.tilt_attachment_deg, rel=0.2)


def test_a_wander_has_unit_variance_and_its_time() -> None:
    random = np.random.default_rng(5)
    values = np.stack([wander(3000, 0.3, random) for _ in range(300)])
    assert np.std(values) == pytest.approx(1.0, abs=0.05)
    assert np.std(values[:, 0]) == pytest.approx(1.0, abs=0.15)
    correlation = np.mean(values[:, 1000] * values[:, 1300])
    assert correlation == pytest.approx(np.exp(-0.25), abs=0.15)


def test_without_spread_every_slide_is_the_intended_one() -> None:
    still = dataclasses.replace(
        P, speed_session_spread=0.0, speed_scan_spread=0.0, speed_wander_spread=0.0
    )
    habits = draw_habits(still, np.random.default_rng(0))
    for profile in (VelocityProfile.SLOW, VelocityProfile.MEDIUM, VelocityProfile.FAST):
        slide = draw_slide(still, habits, profile, np.random.default_rng(1))
        assert _halves(slide) == pytest.approx(intended_speeds(P, profile), rel=0.02)
