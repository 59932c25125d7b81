"""The velocity of a batch: exact where it can be, marked where it is bridged or held."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigctl.errors import WrongUse
from rigctl.finger.trackers.plate_frame import PlateFrame
from rigctl.finger.trackers.velocity import BatchVelocity, EstimateSource, VelocityEstimator
from rigctl.values import Position

STEP_S = 0.01


def estimator_of(path: Iterable[tuple[float, float]]) -> VelocityEstimator:
    """An estimator that got (time, place along the plate)."""
    estimator = VelocityEstimator(PlateFrame())
    for at_s, along_mm in path:
        estimator.add(Position(at_s, along_mm, 0.0, 0.0, True))
    return estimator


def steady(speed_mm_s: float = 100.0, seconds: float = 1.0) -> list[tuple[float, float]]:
    return [(i * STEP_S, i * STEP_S * speed_mm_s) for i in range(round(seconds / STEP_S) + 1)]


def estimate(estimator: VelocityEstimator, start_s: float, end_s: float) -> BatchVelocity:
    velocity = estimator.mean_velocity(start_s, end_s)
    assert velocity is not None
    return velocity


pieces = st.lists(
    st.tuples(st.floats(0.004, 0.028), st.floats(-200, 200)), min_size=10, max_size=60
)


@settings(max_examples=200, deadline=None)
@given(pieces, st.floats(0, 1), st.floats(0, 1))
def test_piecewise_constant_velocity_is_estimated_exactly(
    path: list[tuple[float, float]], one: float, other: float
) -> None:
    durations, speeds = np.array(path).T
    times = np.concatenate([[0.0], np.cumsum(durations)])
    places = np.concatenate([[0.0], np.cumsum(durations * speeds)])
    start_s, end_s = sorted((one * times[-1], other * times[-1]))
    if end_s - start_s < 0.01:
        return
    estimator = estimator_of(zip(times.tolist(), places.tolist(), strict=True))
    overlap = np.clip(np.minimum(times[1:], end_s) - np.maximum(times[:-1], start_s), 0, None)
    velocity = estimate(estimator, start_s, end_s)
    assert velocity.mm_s == pytest.approx(overlap @ speeds / (end_s - start_s), abs=1e-6)
    assert velocity.um_per_s == max(0, round(velocity.mm_s * 1000))
    assert velocity.source is EstimateSource.MEASURED
    assert estimator.path_counters.outliers == 0


def test_batches_add_up_to_the_whole_displacement() -> None:
    along = lambda t: 50 + 60 * t + 40 * np.sin(3 * t)  # noqa: E731
    estimator = estimator_of([(t, float(along(t))) for t in np.arange(0, 2.005, 0.011)])
    batches = [estimate(estimator, k / 10, (k + 1) / 10).mm_s for k in range(19)]
    first, last = estimator.along_mm(0.0), estimator.along_mm(1.9)
    assert first is not None and last is not None
    assert sum(batches) * 0.1 == pytest.approx(last - first, abs=1e-9)


def test_an_estimate_waits_until_the_positions_reach_the_end() -> None:
    estimator = estimator_of(steady(seconds=0.5))
    assert estimator.mean_velocity(0.45, 0.55) is None
    assert estimator.mean_velocity(0.45, 0.55, now_s=0.56) is None
    assert estimator.along_mm(0.51) is None
    estimator.add(Position(0.55, 55.0, 0.0, 0.0, True))
    assert estimate(estimator, 0.45, 0.55).mm_s == pytest.approx(100.0)
    assert estimator.along_mm(0.525) == pytest.approx(52.5)
    with pytest.raises(WrongUse, match="has no duration"):
        estimator.mean_velocity(0.3, 0.3)


def test_standing_still_is_zero_and_going_back_is_negative_but_zero_for_the_board() -> None:
    assert estimate(estimator_of(steady(0.0)), 0.2, 0.3)[:2] == (0.0, 0)
    estimator = estimator_of(steady(-80.0))
    velocity = estimate(estimator, 0.2, 0.3)
    assert velocity.mm_s == pytest.approx(-80.0)
    assert velocity.um_per_s == 0
    assert estimator.counters.reversed == 1


def test_a_dropout_of_100_ms_is_bridged_and_a_longer_one_holds_the_batch_before() -> None:
    def without(begin_s: float, end_s: float) -> VelocityEstimator:
        path = [(t, 100 * t + (50 * (t - 0.5) if t > 0.5 else 0)) for t, _ in steady()]
        return estimator_of([(t, x) for t, x in path if not begin_s < t < end_s])

    bridged = without(0.405, 0.495)
    velocity = estimate(bridged, 0.4, 0.5)
    assert (velocity.source, velocity.dropouts) == (EstimateSource.INTERPOLATED, 1)
    assert velocity.mm_s == pytest.approx(100.0)
    held = without(0.505, 0.645)
    before = estimate(held, 0.4, 0.5)
    for start_s in (0.5, 0.6):
        velocity = estimate(held, start_s, start_s + 0.1)
        assert (velocity.source, velocity.mm_s) == (EstimateSource.HELD, before.mm_s)
    after = estimate(held, 0.7, 0.8)
    assert (after.source, round(after.mm_s)) == (EstimateSource.MEASURED, 150)
    assert (held.counters.held, held.counters.measured) == (2, 2)
    assert held.along_mm(0.55) is None


def test_a_silent_or_lost_tracker_is_held_after_100_ms_and_not_before() -> None:
    estimator = estimator_of(steady(seconds=0.5))
    assert estimate(estimator, 0.4, 0.5).mm_s == pytest.approx(100.0)
    assert estimator.mean_velocity(0.5, 0.6, now_s=0.6) is None
    velocity = estimator.mean_velocity(0.5, 0.6, now_s=0.601)
    assert velocity is not None and velocity.source is EstimateSource.HELD
    assert velocity.mm_s == pytest.approx(100.0)
    for step in range(51, 71):
        estimator.add(Position(step * STEP_S, 0.0, 0.0, 0.0, False))
    velocity = estimate(estimator, 0.6, 0.7)
    assert (velocity.source, velocity.positions) == (EstimateSource.HELD, 0)
    assert estimator.path_counters.invalid == 20


def test_a_scan_without_a_path_begins_with_zero() -> None:
    estimator = estimator_of(steady(seconds=0.5))
    estimate(estimator, 0.4, 0.5)
    estimator.begin_scan()
    velocity = estimator.mean_velocity(2.0, 2.1, now_s=2.11)
    assert velocity is not None
    assert (velocity.um_per_s, velocity.source) == (0, EstimateSource.HELD)
    fresh = estimator_of([])
    assert fresh.mean_velocity(0.0, 0.1, now_s=0.05) is None
    velocity = fresh.mean_velocity(0.0, 0.1, now_s=0.2)
    assert velocity is not None and velocity.source is EstimateSource.HELD


@settings(max_examples=100, deadline=None)
@given(st.integers(5, 95), st.floats(8, 5000), st.sampled_from([-1.0, 1.0]))
def test_a_single_jump_is_left_out_and_counted(at: int, jump_mm: float, sign: float) -> None:
    path = steady()
    path[at] = (path[at][0], path[at][1] + sign * jump_mm)
    estimator = estimator_of(path)
    for k in range(9):
        assert estimate(estimator, k / 10, (k + 1) / 10).mm_s == pytest.approx(100.0)
    assert estimator.path_counters.outliers == 1
    assert estimator.path_counters.relocations == 0


def test_a_jump_at_the_end_of_a_batch_delays_its_estimate() -> None:
    estimator = estimator_of(steady(seconds=0.49))
    estimator.add(Position(0.50, 70.0, 0.0, 0.0, True))
    assert estimator.mean_velocity(0.4, 0.5) is None
    estimator.add(Position(0.51, 51.0, 0.0, 0.0, True))
    velocity = estimate(estimator, 0.4, 0.5)
    assert (round(velocity.mm_s, 6), velocity.outliers) == (100.0, 1)


def test_a_tracker_that_finds_itself_again_elsewhere_moves_no_finger() -> None:
    estimator = estimator_of([(t, x + (200.0 if t > 0.455 else 0.0)) for t, x in steady()])
    assert estimate(estimator, 0.3, 0.4).mm_s == pytest.approx(100.0)
    assert estimate(estimator, 0.4, 0.5).source is EstimateSource.HELD
    velocity = estimate(estimator, 0.5, 0.6)
    assert (velocity.source, round(velocity.mm_s, 6)) == (EstimateSource.MEASURED, 100.0)
    assert estimator.path_counters.relocations == 1
    assert estimator.path_counters.outliers == 0


def test_an_abrupt_start_is_a_movement_and_no_outlier() -> None:
    path = [(t, max(0.0, t - 0.5) * 1500.0) for t, _ in steady()]
    estimator = estimator_of(path)
    assert estimate(estimator, 0.5, 0.6).mm_s == pytest.approx(1500.0)
    counters = estimator.path_counters
    assert (counters.outliers, counters.relocations) == (0, 0)


def test_times_that_run_back_are_counted_and_ignored() -> None:
    path = steady()
    estimator = estimator_of([*path[:50], (0.2, 99.0), path[49], *path[50:]])
    assert estimate(estimator, 0.4, 0.6).mm_s == pytest.approx(100.0)
    assert estimator.path_counters.out_of_order == 2


def test_noise_gives_the_error_that_it_must() -> None:
    random = np.random.default_rng(1)
    noise = random.normal(0.0, 0.3, (3001, 3))
    estimator = VelocityEstimator(PlateFrame())
    for (at_s, along_mm), (x, y, z) in zip(steady(8.0, 30.0), noise, strict=True):
        estimator.add(Position(at_s, along_mm + x, y, z, True))
    errors = [estimate(estimator, k / 10, (k + 1) / 10).mm_s - 8.0 for k in range(299)]
    assert np.std(errors) == pytest.approx(np.sqrt(2) * 0.3 / 0.1, rel=0.15)
    assert estimator.path_counters.outliers == 0


def test_hours_of_positions_take_no_more_memory() -> None:
    estimator = estimator_of((i / 50, 0.0) for i in range(20_000))
    assert len(estimator._path._points) <= 50 * 61
    assert estimate(estimator, 390.0, 390.1).um_per_s == 0
    assert estimate(estimator, 10.0, 10.1).source is EstimateSource.HELD
