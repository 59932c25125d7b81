"""Conductances undo the load of the taxels that share an input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.bench.skin import divider_share
from rigctl.encoder.encoder import Encoder, encode_trial, encode_trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import DEFAULT, EncoderParameters, override, preset
from rigctl.encoder.reading import (
    HIGHEST,
    STEPS,
    Reading,
    conductance,
    divider_table,
    input_of_each,
    quantisation_error,
)
from rigctl.errors import WrongUse
from rigctl.values import DRAWN_WIRING

IN_ORDER = tuple(range(18))
INPUTS = input_of_each(IN_ORDER, 6, "test")
CONDUCTANCE = replace(DEFAULT, reading=Reading.CONDUCTANCE)
HALF_COUNT = 0.5 / 1023
"""Greatest error of a share by quantisation."""
HALF_STEP = 0.5 / STEPS

Floats = NDArray[np.float64]
conductances = st.lists(st.floats(0.0, 4.0), min_size=18, max_size=18).map(np.array)


def shares_of(own: Floats) -> Floats:
    """Return what each input reads of taxels (…, 18), by the simulated sensor's circuit."""
    together = np.tile(own.reshape(*own.shape[:-1], 3, 6).sum(axis=-2), 3)
    shares: Floats = np.vectorize(divider_share)(own, together)
    return shares


def counts_of(shares: Floats) -> NDArray[np.uint16]:
    """Return readings, rounded to counts."""
    return (shares * 1023 + 0.5).astype(np.uint16)


def error_bound(own: Floats, change: float = 0.0) -> Floats:
    """Return the bound of docs/reference/encoding.md, in units of the divider's conductance.

    ``change``: of any conductance of the input in the 0.6 ms between its three readings.
    """
    together = np.tile(own.reshape(3, 6).sum(axis=0), 3)
    left = 1 / (1 + together)
    others = 3 * HALF_COUNT + 5 * change * left
    bound: Floats = (HALF_COUNT + own * others) / (left - others) + HALF_STEP
    return bound


@given(conductances)
def test_conductance_counts_conductance_comes_back_within_the_quantisation(own: Floats) -> None:
    found = conductance(counts_of(shares_of(own))[None], INPUTS)[0] / STEPS
    assert np.all(np.abs(found - own) <= error_bound(own) + 1e-12)


@given(conductances, conductances.map(lambda values: values - 2.0), st.floats(0.0, 0.02))
def test_the_error_stays_in_its_bound_while_the_readings_are_taken(
    own: Floats, direction: Floats, change: float
) -> None:
    """Lines are read 0.3 ms apart: each taxel is right for the time of its own reading."""
    rate = direction / max(np.abs(direction).max(), 1e-9) * change  # in 0.6 ms
    at_line = [np.maximum(own + rate * line / 2, 0.0) for line in range(3)]
    rows = [shares_of(conducting).reshape(3, 6)[line] for line, conducting in enumerate(at_line)]
    found = conductance(counts_of(np.concatenate(rows))[None], INPUTS)[0] / STEPS
    for line, conducting in enumerate(at_line):
        off, bound = np.abs(found - conducting), error_bound(conducting, change)
        assert np.all((off <= bound + 1e-12).reshape(3, 6)[line])


def test_a_pressed_taxel_has_the_same_conductance_whatever_its_neighbours_do() -> None:
    """5 kΩ with dividers of 10 kΩ: 660 counts beside taxels at rest, 292 beside pressed ones."""
    for counts, others in ((660, 16), (292, 292)):
        samples = np.full((1, 18), others, np.uint16)
        samples[0, :6] = counts
        found = conductance(samples, INPUTS)[0, :6] / STEPS
        assert np.all(np.abs(found - 2.0) < 0.02)


def test_a_permuted_wiring_is_followed() -> None:
    random = np.random.default_rng(3)
    samples = random.integers(0, 340, (50, 18)).astype(np.uint16)
    wiring = tuple(random.permutation(18).tolist())
    expected = conductance(samples, INPUTS)[:, wiring]
    assert np.array_equal(conductance(samples[:, wiring], input_of_each(wiring, 6, "x")), expected)
    drawn = samples[:, DRAWN_WIRING]
    assert not np.array_equal(
        conductance(drawn, INPUTS), conductance(drawn, input_of_each(DRAWN_WIRING, 6, "x"))
    )


def test_a_short_saturates_and_a_sensor_without_known_inputs_is_refused() -> None:
    samples = np.zeros((1, 18), np.uint16)
    samples[0, 7] = 1023
    found = conductance(samples, INPUTS)[0]
    assert found[7] == HIGHEST and np.count_nonzero(found) == 1
    for wiring in ((), tuple(range(9))):
        with pytest.raises(WrongUse, match=r"a session does not say .* use reading = counts"):
            input_of_each(wiring, 6, "a session")


@pytest.mark.parametrize("slices", [1, 7, 100])
def test_live_and_offline_give_equal_spikes_in_both_readings(slices: int) -> None:
    random = np.random.default_rng(slices)
    level = np.abs(np.sin(np.arange(1500)[:, None] / (40 + 3 * np.arange(18))))
    samples = (level * 250 + random.integers(0, 20, (1500, 18))).astype(np.uint16)
    spikes = []
    for parameters in (DEFAULT, CONDUCTANCE):
        is_counts = parameters.reading is Reading.COUNTS
        readings = samples if is_counts else conductance(samples, INPUTS)
        ranges = Normalisation.from_samples([readings], "all", parameters.reading)
        offline = encode_trial(readings, ranges, parameters)
        encoder = Encoder(ranges, parameters, inputs=() if is_counts else INPUTS)
        live = np.concatenate([encoder.encode(part) for part in np.array_split(samples, slices)])
        for row in range(36):
            assert np.array_equal(np.repeat(np.arange(1500), live[:, row]), offline.train(row))
        spikes.append(live)
    assert not np.array_equal(*spikes)


def test_ranges_and_encoders_of_different_readings_are_not_mixed() -> None:
    samples = np.full((10, 18), 100, np.uint16)
    counted = Normalisation.full_scale(18)
    with pytest.raises(WrongUse, match="are of counts, encoder default takes conductance"):
        encode_trials([samples], counted, CONDUCTANCE)
    with pytest.raises(WrongUse, match="same reading"):
        Encoder(counted, CONDUCTANCE, inputs=INPUTS)
    encoder = Encoder(counted)
    with pytest.raises(WrongUse, match="are of conductance"):
        encoder.normalisation = Normalisation.full_scale(18, reading=Reading.CONDUCTANCE)


def test_the_page_shows_what_each_divider_gives_and_costs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "encoding.md").read_text("utf-8")
    assert divider_table() in page, "run python -m rigctl.encoder.reading"
    assert "| 10 | 44 | 660 | 292 | 56% |" in divider_table()
    own = np.repeat([2.0, 0.05, 0.05], 6)  # 10 kΩ over 5 and 200 kΩ
    found = quantisation_error(2.0, 2.1) + HALF_STEP
    assert found == pytest.approx(error_bound(own)[0])


def test_the_reading_is_a_named_parameter() -> None:
    named = override(preset("default"), ["reading=conductance"])
    assert named.name == "default, reading=conductance"
    assert EncoderParameters.from_dict(named.as_dict()) == named
    with pytest.raises(WrongUse, match="give one of counts, conductance"):
        override(preset("default"), ["reading=volts"])
