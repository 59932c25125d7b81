"""Windows, rates and counts in cases small enough to compute by hand."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import (
    SPEED_SCALED,
    UNSCALED,
    FeatureLayout,
    feature_matrices,
    trial_features,
)
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import WrongUse
from rigctl.values import Spikes

PAPER_SPEEDS = (40, 60, 80, 100, 120)


def spikes_of(trains: list[list[int]], n_samples: int) -> Spikes:
    starts = np.cumsum([0] + [len(train) for train in trains])
    flat = np.array([t for train in trains for t in train], np.int32)
    return Spikes(starts.astype(np.int64), flat, n_samples)


@pytest.mark.parametrize("speed", PAPER_SPEEDS)
def test_the_papers_trials_fill_twenty_equal_windows(speed: int) -> None:
    n = 240 * 1000 // speed
    windows = SPEED_SCALED.sample_windows(n, speed)
    assert np.bincount(windows).tolist() == [n // 20] * 20
    assert windows.tolist() == [(t * speed) // 12000 for t in range(n)]


@given(t=st.integers(0, 10_000), speed=st.integers(1, 400_000))
def test_windows_are_exact_to_the_micrometre_per_second(t: int, speed: int) -> None:
    exact = Fraction(t * speed, 1000 * 1000) / (120 * Fraction(1, 10))
    assert SPEED_SCALED.sample_windows(t + 1, speed / 1000)[t] == exact.__floor__()


@given(
    n=st.integers(0, 3000),
    speed=st.integers(1, 400_000) | st.integers(200_000_000, 10**9),
    windows=st.integers(1, 70),
    scaled=st.booleans(),
)
def test_window_starts_and_durations_match_the_sample_windows(
    n: int, speed: int, windows: int, scaled: bool
) -> None:
    """Even if a window is too short for a sample."""
    layout = FeatureLayout(windows, scaled)
    sample_windows = layout.sample_windows(n, speed / 1000)
    inside = sample_windows[sample_windows < windows]
    per_window = np.bincount(inside, minlength=windows)
    assert layout.window_durations_s(n, speed / 1000).tolist() == (per_window / 1000).tolist()
    assert layout.window_durations_s([n, 0], speed / 1000).tolist()[1] == [0.0] * windows
    starts = layout.window_starts(speed / 1000)
    firsts = np.searchsorted(sample_windows, np.arange(windows + 1))
    assert np.minimum(starts, n).tolist() == firsts.tolist()


def test_other_windows_and_references() -> None:
    windows = FeatureLayout(3, True, window_ms=2, reference_mm_s=100.0).sample_windows(10, 50.0)
    assert windows.tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2, 2]
    with pytest.raises(WrongUse, match="above 0"):
        SPEED_SCALED.sample_windows(10, 0.0)
    with pytest.raises(WrongUse, match="no sample"):
        FeatureLayout(3, True, window_ms=0).sample_windows(10, 50.0)


def test_rates_by_hand() -> None:
    """At 60 mm/s a scaled window lasts 200 ms: three SA spikes are 15 Hz, three RA spikes 3."""
    spikes = spikes_of([[0, 100, 199, 200], [0, 199, 200, 201, 399]], n_samples=400)
    scaled = trial_features(spikes, 60.0, FeatureLayout(3, scaled=True))
    assert scaled.tolist() == [15.0, 5.0, 0.0, 2.0, 3.0, 0.0]
    plain = trial_features(spikes, 60.0, FeatureLayout(5, scaled=False))
    assert plain.tolist() == [10.0, 20.0, 10.0, 0.0, 0.0, 1.0, 1.0, 2.0, 1.0, 0.0]


def test_a_short_last_window_is_divided_by_its_real_samples() -> None:
    spikes = spikes_of([[0, 210], [210]], n_samples=250)
    features = trial_features(spikes, 60.0, FeatureLayout(2, scaled=True))
    assert features.tolist() == [5.0, 20.0, 0.0, 1.0]


def test_spikes_behind_the_last_window_are_dropped() -> None:
    spikes = spikes_of([[0, 100, 200], [100, 200]], n_samples=203)
    features = trial_features(spikes, 120.0, FeatureLayout(2, scaled=True))
    assert features.tolist() == [10.0, 10.0, 0.0, 1.0]


def test_the_layouts_have_the_papers_number_of_features() -> None:
    assert SPEED_SCALED.n_features(18) == 720
    assert UNSCALED.n_features(18) == 2160


def test_both_ends_of_six_seconds_make_the_papers_windows() -> None:
    trials = [np.full((n, 18), 500, np.uint16) for n in (6001, 2001)]
    speeds = [40.0, 120.0]
    layouts = [
        FeatureLayout.covering(list(map(len, trials)), speeds, scaled=scaled)
        for scaled in (True, False)
    ]
    scaled, unscaled = feature_matrices(trials, speeds, Normalisation.full_scale(18), layouts)
    assert scaled.shape == (2, 720) and unscaled.shape == (2, 2160)


def test_a_layout_covers_a_set_of_trials() -> None:
    lengths, speeds = [6000, 2403, 2000], [40.0, 100.0, 120.0]
    assert FeatureLayout.covering(lengths, speeds, scaled=True) == SPEED_SCALED
    assert FeatureLayout.covering(lengths, speeds, scaled=False) == UNSCALED
    for n_samples, n_windows in ((130, 1), (149, 1), (150, 2), (250, 3), (6001, 60), (6050, 61)):
        layout = FeatureLayout.covering([n_samples], [40.0], scaled=False)
        assert layout.n_windows == n_windows
    assert FeatureLayout.covering([], [], scaled=True).n_windows == 1


def test_matrices_equal_the_features_of_single_trials() -> None:
    rng = np.random.default_rng(0)
    speeds = [40.0, 60.0, 80.0, 100.0, 120.0, 77.7, 40.0]
    trials = [rng.integers(200, 800, (round(60_000 / v) + 3, 5)).astype(np.uint16) for v in speeds]
    ranges = Normalisation.full_scale(5)
    scale = rng.uniform(0.5, 2.0, (len(trials), 5))
    layouts = [FeatureLayout(5, scaled=True), FeatureLayout(16, scaled=False)]
    matrices = feature_matrices(trials, speeds, ranges, layouts, sa_scale=scale)
    spikes = encode_trials(trials, ranges, sa_scale=scale)
    for layout, matrix in zip(layouts, matrices, strict=True):
        assert matrix.shape == (7, layout.n_features(5))
        for row, (train, speed) in enumerate(zip(spikes, speeds, strict=True)):
            np.testing.assert_array_equal(matrix[row], trial_features(train, speed, layout))
    assert matrices[0].any(axis=1).all()


def test_each_trial_needs_a_speed() -> None:
    with pytest.raises(WrongUse, match="2 trials, but 1 speeds"):
        feature_matrices(
            [np.zeros((5, 1), np.uint16)] * 2, [40.0], Normalisation.full_scale(1), [SPEED_SCALED]
        )
