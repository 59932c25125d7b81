"""The gain of the SA current by the sum of all readings: exact, stateless, live as offline."""

from __future__ import annotations

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
TOP, BOTTOM = FORCES_G**0.8, 40.0 * FORCES_G**0.4
CURVES = np.column_stack([TOP] * 9 + [BOTTOM] * 9)
LAYERS = [0] * 9 + [1] * 9


def touch(n: int, seed: int = 1) -> NDArray[np.uint16]:
    """Return readings of a texture under a force that rises threefold."""
    rng = np.random.default_rng(seed)
    press = np.linspace(300, 900, n)[:, None]
    ridges = 1.0 + 0.5 * np.sin(np.arange(n)[:, None] / 9.0 + np.arange(18) / 3.0)
    return np.round(press * ridges + rng.normal(0, 4, (n, 18))).astype(np.uint16)


def by_hand(gain: ForceGain, sample: list[int]) -> list[int]:
    """Return a sample as a board computes it: whole numbers, one operation after another."""
    total = sum(sample)
    knot = min(total >> gain.shift, KNOTS - 1)
    into = min(total - (knot << gain.shift), 1 << gain.shift)
    gains = [of[knot] + ((of[knot + 1] - of[knot]) * into >> gain.shift) for of in gain.gains]
    layers = zip(sample, gain.layer, strict=True)
    return [min(reading * gains[layer] >> 12, HIGHEST) for reading, layer in layers]


@given(st.lists(st.integers(0, HIGHEST), min_size=18, max_size=18))
def test_every_sample_is_whole_number_arithmetic(sample: list[int]) -> None:
    for gain in (divided(RANGES), calibrated(FORCES_G, CURVES, LAYERS)):
        found = gain.apply(np.array([sample], np.uint16))
        assert found[0].tolist() == by_hand(gain, sample)


def test_divided_readings_are_shares_of_all() -> None:
    readings = touch(400)
    shares = divided(RANGES).apply(readings) / (readings / readings.sum(axis=1, keepdims=True))
    assert shares.std() / shares.mean() < 0.01
    middle = np.full((1, 18), 1240, np.uint16)  # the sum at which nothing changes
    np.testing.assert_allclose(divided(RANGES).apply(middle), middle, rtol=0.01)


def test_calibrated_plate_reads_the_same_at_every_force() -> None:
    plate = np.round(CURVES[1:]).astype(np.uint16)
    scaled = calibrated(FORCES_G, CURVES, LAYERS).apply(plate)
    at_reference = CURVES[3]
    np.testing.assert_allclose(scaled, np.tile(at_reference, (5, 1)), rtol=0.04)
    lower = calibrated(FORCES_G, CURVES, LAYERS, reference_g=250.0).apply(plate)
    np.testing.assert_allclose(lower, np.tile(CURVES[2], (5, 1)), rtol=0.04)


def test_tilt_of_the_plate_does_not_change_the_gain() -> None:
    """On the bench the curves of single taxels lost all accuracy to one tilted plate."""
    tilt = 1.0 + 0.3 * (np.arange(18) % 9 - 4) / 4.0
    level = calibrated(FORCES_G, CURVES, LAYERS)
    tilted = calibrated(FORCES_G, CURVES * tilt, LAYERS)
    np.testing.assert_allclose(tilted.gains, level.gains, atol=2)


def test_gain_is_limited_where_nothing_presses() -> None:
    for gain in (divided(RANGES), calibrated(FORCES_G, CURVES, LAYERS)):
        untouched = np.full((1, 18), 3, np.uint16)
        assert (gain.apply(untouched) <= 3 * LIMIT_C).all()
        assert all(0 <= one <= HIGHEST_GAIN for of_layer in gain.gains for one in of_layer)
        assert gain.apply(np.full((1, 18), HIGHEST, np.uint16)).max() <= HIGHEST
        assert UNIT == 1 << 12


@pytest.mark.parametrize("slices", [[400], [1] * 400, [7, 150, 1, 242]])
def test_live_spikes_are_those_of_the_analysis(slices: list[int]) -> None:
    readings = touch(400)
    gain = calibrated(FORCES_G, CURVES, LAYERS)
    encoder = Encoder(RANGES, gain_of=lambda _: gain)
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
