"""Counts in time bins against the trains of the same trials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.encoder import encoder
from rigctl.encoder.batch import (
    common_bin_edges,
    count_spikes,
    count_spikes_without_and_with_c,
    features_from_counts,
    mean_normalised_reading,
    sa_rates_hz,
    single_bin_edges,
)
from rigctl.encoder.encoder import encode_trials
from rigctl.encoder.features import SPEED_SCALED, UNSCALED, FeatureLayout, trial_features
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, PRESETS
from rigctl.errors import WrongUse

RANGES = Normalisation.full_scale(5)
LAYOUTS = (UNSCALED, SPEED_SCALED)


def readings(lengths: list[int], seed: int = 0) -> list[NDArray[np.uint16]]:
    rng = np.random.default_rng(seed)
    t = np.arange(max(lengths))[:, None] / 1000
    wave = 0.5 + 0.3 * np.sin(2 * np.pi * (3 + np.arange(5)) * t)
    return [
        np.round(1023 * np.clip(wave[:n] + rng.normal(0, 0.02, (n, 5)), 0, 1)).astype(np.uint16)
        for n in lengths
    ]


@pytest.mark.parametrize("name", ["default", "izhikevich2003"])
def test_counts_equal_those_of_the_trains(name: str) -> None:
    trials = readings([1500, 1499, 0, 800, 1500, 1, 1203, 1500, 1498, 1500])
    scale = np.random.default_rng(1).uniform(0.5, 1.5, (len(trials), 5))
    bin_edges = common_bin_edges(LAYOUTS, 1500, 100.0)
    counts = count_spikes(trials, bin_edges, RANGES, PRESETS[name], sa_scale=scale)
    spikes = encode_trials(trials, RANGES, PRESETS[name], sa_scale=scale)
    for trial, binned in zip(spikes, counts, strict=True):
        for row in range(10):
            expected = np.histogram(trial.train(row), bin_edges)[0]
            np.testing.assert_array_equal(binned[row], expected)
    assert counts.sum() > 0


@pytest.mark.parametrize("n", [1, 7, 61])
def test_counts_without_and_with_c_equal_separate_counts(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tiles have blocks of two widths; many trials make several tiles."""
    monkeypatch.setattr(encoder, "TILE_LANES", 100)
    rng = np.random.default_rng(n)
    trials = readings([900, *rng.integers(0, 900, n - 1).tolist()], n)
    scale, bin_edges = rng.uniform(0.5, 2, (n, 5)), common_bin_edges(LAYOUTS, 900, 80.0)
    without, with_c = count_spikes_without_and_with_c(trials, bin_edges, RANGES, DEFAULT, scale)
    np.testing.assert_array_equal(without, count_spikes(trials, bin_edges, RANGES))
    alone = count_spikes(trials, bin_edges, RANGES, sa_scale=scale, sa_only=True)
    np.testing.assert_array_equal(with_c, alone)
    assert (without[:, :5] != with_c).any()


def test_trials_without_a_sample_have_no_spikes() -> None:
    nothing = [np.zeros((0, 5), np.uint16)] * 3
    counts = count_spikes(nothing, np.array([0, 100, 200]), RANGES)
    assert counts.shape == (3, 10, 2) and not counts.any()


@pytest.mark.parametrize(
    ("widths", "last", "taxels", "words"),
    [
        ((4, 4), 900, [0], "samples have 4 taxels, but the ranges have 5"),
        ((5, 4), 900, [0], "shapes"),
        ((5, 5), 899, [0], "a trial has 900 samples, but the last bin edge is 899"),
        ((5, 5), 900, [-1], r"taxels \[-1\] are not all within 0 to 4"),
        ((5, 5), 900, [5], r"taxels \[5\] are not all within 0 to 4"),
    ],
)
def test_readings_outside_the_trials_are_refused(
    widths: tuple[int, ...], last: int, taxels: list[int], words: str
) -> None:
    trials = [np.zeros((900, width), np.uint16) for width in widths]
    with pytest.raises(WrongUse, match=words):
        count_spikes(trials, np.array([0, last]), RANGES, taxels=np.array(taxels))


def test_neighbouring_taxels_count_as_among_all() -> None:
    """Runs of eight taxels, in blocks of both widths, begin before the selected ones."""
    rng, ranges = np.random.default_rng(2), Normalisation.full_scale(18)
    trials = [rng.integers(0, 1024, (n, 18)).astype(np.uint16) for n in (70, 64, 33, 70, 1)]
    chosen, bin_edges = np.arange(5, 17), single_bin_edges(trials)
    both = count_spikes(trials, bin_edges, ranges)
    some = count_spikes(trials, bin_edges, ranges, taxels=chosen)
    np.testing.assert_array_equal(some, both[:, [*chosen, *(18 + chosen)]])
    alone = count_spikes(trials, bin_edges, ranges, taxels=chosen, sa_only=True)
    np.testing.assert_array_equal(alone, both[:, chosen])


def test_some_taxels_and_sa_alone_count_as_among_all() -> None:
    trials = readings([900, 870, 900])
    bin_edges, scale = single_bin_edges(trials), np.full((3, 5), 1.2)
    both = count_spikes(trials, bin_edges, RANGES, sa_scale=scale)
    chosen = np.array([1, 4])
    some = count_spikes(trials, bin_edges, RANGES, sa_scale=scale[:, chosen], taxels=chosen)
    np.testing.assert_array_equal(some, both[:, [1, 4, 6, 9]])
    alone = count_spikes(trials, bin_edges, RANGES, sa_scale=scale, sa_only=True)
    np.testing.assert_array_equal(alone, both[:, :5])


@pytest.mark.parametrize("speed", [40.0, 67.3, 100.0, 120.0])
def test_features_equal_those_of_the_trains(speed: float) -> None:
    trials = readings([2400, 2390, 700, 1])
    layouts = (*LAYOUTS, FeatureLayout(4, scaled=False), FeatureLayout(3, scaled=True))
    bin_edges = common_bin_edges(layouts, 2400, speed)
    counts = count_spikes(trials, bin_edges, RANGES)
    spikes = encode_trials(trials, RANGES)
    for layout in layouts:
        features = features_from_counts(counts, bin_edges, list(map(len, trials)), speed, layout)
        expected = np.stack([trial_features(trial, speed, layout) for trial in spikes])
        np.testing.assert_array_equal(features, expected)


def test_rates_and_readings_are_means_over_trials() -> None:
    trials = readings([1000, 500, 997])
    counts = count_spikes(trials, single_bin_edges(trials), RANGES, sa_only=True)
    rates = sa_rates_hz(counts, [1000, 500, 997], DEFAULT)
    spikes = encode_trials(trials, RANGES)
    each = [[len(s.train(i)) / (s.n_samples / 1000) for i in range(5)] for s in spikes]
    np.testing.assert_allclose(rates, np.mean(each, axis=0), rtol=1e-12)
    narrow = Normalisation(np.full(5, 300, np.uint16), np.full(5, 700, np.uint16))
    cut = [(np.clip(s[::16], 300, 700) - 300.0).mean(axis=0) / 400 for s in trials]
    np.testing.assert_allclose(
        mean_normalised_reading(trials, narrow), np.mean(cut, axis=0), rtol=1e-12
    )
