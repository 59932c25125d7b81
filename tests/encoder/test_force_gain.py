"""The gain of the SA current by the sum of all readings: exact, stateless, live as offline."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.encoder.encoder import Encoder, encode_trials
from rigctl.encoder.force_gain import HIGHEST_GAIN, KNOTS, UNIT, ForceGain, calibrated, divided
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.reading import HIGHEST
from rigctl.encoder.root_bracket import LIMIT_C

RANGES = Normalisation(np.full(18, 80, np.uint16), np.full(18, 2400, np.uint16))
FORCES_G = np.array([75.0, 150.0, 250.0, 500.0, 1000.0, 1200.0])
CURVES = 80.0 + np.linspace(2.0, 9.0, 18) * FORCES_G[:, None] ** 0.7


def touch(n: int, seed: int = 1) -> NDArray[np.uint16]:
    """Return readings of a texture under a force that rises threefold."""
    rng = np.random.default_rng(seed)
    press = np.linspace(300, 900, n)[:, None]
    ridges = 1.0 + 0.5 * np.sin(np.arange(n)[:, None] / 9.0 + np.arange(18) / 3.0)
    return np.round(press * ridges + rng.normal(0, 4, (n, 18))).astype(np.uint16)


def by_hand(gain: ForceGain, sample: list[int]) -> list[int]:
    """Return a sample as a board computes it: whole numbers, one operation after another."""
    above = [max(reading - base, 0) for reading, base in zip(sample, gain.base, strict=True)]
    total = sum(above)
    knot = min(total >> gain.shift, KNOTS - 1)
    into = min(total - (knot << gain.shift), 1 << gain.shift)
    low, high = gain.gains[knot : knot + 2]
    now = low + ((high - low) * into >> gain.shift)
    taxels = zip(sample, above, gain.base, strict=True)
    return [min(base + (over * now >> 12), HIGHEST) if over else x for x, over, base in taxels]


@given(st.lists(st.integers(0, HIGHEST), min_size=18, max_size=18))
def test_every_sample_is_whole_number_arithmetic(sample: list[int]) -> None:
    for gain in (divided(RANGES), calibrated(FORCES_G, CURVES, RANGES)):
        found = gain.apply(np.array([sample], np.uint16))
        assert found[0].tolist() == by_hand(gain, sample)


def test_divided_currents_are_shares_of_all() -> None:
    readings = touch(400).astype(int)
    above = readings - 80
    shares = (divided(RANGES).apply(readings.astype(np.uint16)) - 80.0) / above
    shares *= above.sum(axis=1, keepdims=True)
    assert shares[above > 100].std() / shares[above > 100].mean() < 0.01
    middle = np.full((1, 18), 1240, np.uint16)  # the sum at which nothing changes
    np.testing.assert_allclose(divided(RANGES).apply(middle), middle, rtol=0.01)


def test_calibrated_plate_reads_the_same_at_every_force() -> None:
    plate = np.round(CURVES).astype(np.uint16)
    for reference_g, row in ((500.0, 3), (250.0, 2)):
        gain = calibrated(FORCES_G, CURVES, RANGES, reference_g=reference_g)
        aim = np.tile(CURVES[row], (len(plate), 1))
        np.testing.assert_allclose(gain.apply(plate), aim, rtol=0.03)


def test_beyond_the_calibrated_forces_the_gain_stays() -> None:
    gain = calibrated(FORCES_G, CURVES, RANGES)
    light, heavy = (
        (80 + share * (CURVES[row] - 80)).astype(np.uint16)[None]
        for share, row in ((0.5, 0), (2.0, -1))
    )
    for readings, row in ((light, 0), (heavy, -1)):
        expected = 80 + (readings - 80.0) * (500.0 / FORCES_G[row]) ** 0.7
        np.testing.assert_allclose(gain.apply(readings), expected, rtol=0.03)


def test_gain_is_limited_where_nothing_presses() -> None:
    for gain in (divided(RANGES), calibrated(FORCES_G, CURVES, RANGES)):
        below = np.full((1, 18), 79, np.uint16)
        assert (gain.apply(below) == below).all()
        touched = np.full((1, 18), 83, np.uint16)
        assert (gain.apply(touched) <= 80 + 3 * LIMIT_C).all()
        assert all(0 <= one <= HIGHEST_GAIN for one in gain.gains)
        assert gain.apply(np.full((1, 18), HIGHEST, np.uint16)).max() <= HIGHEST
    assert UNIT == 1 << 12


@pytest.mark.parametrize("slices", [[400], [1] * 400, [7, 150, 1, 242]])
def test_live_spikes_are_those_of_the_analysis(slices: list[int]) -> None:
    readings = touch(400)
    gain = calibrated(FORCES_G, CURVES, RANGES)
    encoder = Encoder(RANGES, gain_of=partial(calibrated, FORCES_G, CURVES))
    ends = np.cumsum(slices)
    parts = [readings[end - n : end] for n, end in zip(slices, ends, strict=True)]
    live = np.concatenate([encoder.encode(part) for part in parts])
    (spikes,) = encode_trials([readings], RANGES, gains=[gain])
    for row in range(36):
        np.testing.assert_array_equal(np.flatnonzero(live[:, row]), np.unique(spikes.train(row)))
    (plain,) = encode_trials([readings], RANGES)
    (scaled,) = encode_trials([gain.apply(readings)], RANGES)
    for row in range(18):
        np.testing.assert_array_equal(spikes.train(row), scaled.train(row))
        np.testing.assert_array_equal(spikes.train(18 + row), plain.train(18 + row))


def test_live_gain_follows_the_ranges() -> None:
    encoder, readings = Encoder(RANGES, gain_of=divided), touch(200)
    wider = Normalisation(RANGES.low, RANGES.high + np.uint16(1000))
    encoder.encode(readings)
    encoder.normalisation = wider
    encoder.reset()
    fresh = Encoder(wider, gain_of=divided)
    np.testing.assert_array_equal(encoder.encode(readings), fresh.encode(readings))
    halfway = fresh.copy()
    np.testing.assert_array_equal(halfway.encode(readings), fresh.encode(readings))
    halfway.reset()
    fired = halfway.membrane_mv(readings) >= 30.0
    np.testing.assert_array_equal(fired, Encoder(wider, gain_of=divided).encode(readings) > 0)
