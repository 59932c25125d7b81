"""Scaled time against sums in exact fractions, and the two feature vectors of the finger."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rigctl.errors import WrongUse
from rigctl.finger.scaled_time import (
    Gaps,
    feature_vector,
    original_features,
    scale_windows,
    speed_scaled_features,
    time_windows,
)


def _spikes(n: int, seed: int = 0) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    return np.random.default_rng(seed).integers(0, 3, (n, 9), dtype=np.uint8)


@pytest.mark.parametrize("reference", [100_000, 99_999, 33_333])
@pytest.mark.to_the_bit
def test_every_sample_is_in_the_window_of_the_exact_integral(reference: int) -> None:
    random = np.random.default_rng(reference)
    velocities = random.integers(0, 250_000, 31)
    spikes = _spikes(3047)
    windows = scale_windows(spikes, velocities, reference)
    scaled_ms, expected = Fraction(0), np.zeros_like(windows.counts)
    real_ms = np.zeros_like(windows.real_ms)
    for sample, row in enumerate(spikes):
        expected[int(scaled_ms // 100)] += row
        real_ms[int(scaled_ms // 100)] += 1
        scaled_ms += Fraction(int(velocities[sample // 100]), reference)
    np.testing.assert_array_equal(windows.counts, expected)
    np.testing.assert_array_equal(windows.real_ms, real_ms)
    assert windows.real_ms.sum() == len(spikes)


@pytest.mark.to_the_bit
def test_at_the_reference_speed_scaled_and_real_windows_are_equal() -> None:
    spikes = _spikes(2000)
    scaled = scale_windows(spikes, np.full(20, 100_000))
    np.testing.assert_array_equal(scaled.counts, time_windows(spikes).counts)
    assert np.array_equal(speed_scaled_features(scaled), original_features(spikes))


@pytest.mark.to_the_bit
def test_a_regular_train_on_the_plate_has_equal_rates_at_any_speed() -> None:
    """A spike each millimetre is v spikes a second, in every window."""
    for mm_s in (50, 100, 200):
        spikes = np.zeros((200_000 // mm_s, 9), np.uint8)
        spikes[:: 1000 // mm_s] = 1
        windows = scale_windows(spikes, np.full(-(-len(spikes) // 100), mm_s * 1000))
        assert len(windows.counts) == 20
        assert np.all(windows.counts == 10) and np.all(windows.rates_hz == mm_s)


@pytest.mark.to_the_bit
def test_whole_gaps_have_the_velocity_of_the_batch_in_which_they_end() -> None:
    spikes = np.zeros((200, 9), np.uint8)
    spikes[[90, 110], 0] = 1
    spikes[110, 1] = 2
    velocities = np.array([50_000, 200_000])
    split = scale_windows(spikes, velocities)
    whole = scale_windows(spikes, velocities, gaps=Gaps.WHOLE)
    # 100 · 0.05 + 10 · 0.2 = 7 mm; 90 · 0.05 + 20 · 0.2 = 8.5 mm; 110 · 0.2 = 22 mm.
    assert np.argwhere(split.counts).tolist() == [[0, 0], [0, 1]]
    assert np.argwhere(whole.counts).tolist() == [[0, 0], [2, 1]]
    assert whole.counts[2, 1] == 2 and whole.real_ms.tolist() == split.real_ms.tolist()
    for other in (Gaps.SPLIT, Gaps.WHOLE):
        steady = scale_windows(_spikes(2000), np.full(20, 73_000), gaps=other)
        assert np.array_equal(steady.counts, scale_windows(_spikes(2000), [73_000] * 20).counts)


def test_a_finger_that_stands_still_stays_in_its_window() -> None:
    windows = scale_windows(_spikes(300), np.array([50_000, 0, 50_000]))
    assert windows.real_ms.tolist() == [300]


def test_features_go_taxel_after_taxel_and_are_padded_or_cut() -> None:
    spikes = np.zeros((2350, 9), np.uint8)
    spikes[300:400, 4] = 1
    spikes[2300:, :] = 1
    long = original_features(spikes).reshape(9, 20)
    assert long[4].tolist() == [1000.0] + [0.0] * 19, "windows 4 to 23; the remainder is dropped"
    short = original_features(spikes[:500]).reshape(9, 20)
    assert short[4, 3] == 1000.0 and short.sum() == 1000.0
    table = np.arange(18.0).reshape(2, 9)
    assert feature_vector(table)[:4].tolist() == [0.0, 9.0, 1.0, 10.0]


@pytest.mark.parametrize(
    ("velocities", "message"),
    [
        ([100_000] * 2, "3 batches"),
        ([100_000, -1, 0], "between 0 and 10000000"),
        ([100_000, 10_000_001, 0], "between 0 and 10000000"),
    ],
)
def test_impossible_velocities_are_refused(velocities: list[int], message: str) -> None:
    with pytest.raises(WrongUse, match=message):
        scale_windows(_spikes(250), np.array(velocities))
