"""Other readings of the RA channel's filter: its signals, and the spikes that follow from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.encoder.batch import count_spikes, count_spikes_without_and_with_c
from rigctl.encoder.encoder import Encoder, encode_trial, encode_trials, membrane_mv
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.parameters import (
    DEFAULT,
    PRESETS,
    SA_PRESETS,
    EncoderParameters,
    RaDerivative,
    RaFilter,
)
from rigctl.encoder.ra_filter import linear_phase_taps, low_pass, ra_signals
from rigctl.encoder.ra_neurons import ra_response
from rigctl.errors import WrongUse
from tests.encoder.test_encoder import N_TAXELS, RANGES, extremes, touch

WHOLE_TRIALS = sorted(name for name, p in PRESETS.items() if p.filters_whole_trials)
LEVEL = 0.5


def sine(frequency_hz: float, n: int = 4000) -> NDArray[np.float64]:
    """Return one normalised reading, float64 (n, 1), around its middle."""
    return LEVEL + 0.4 * np.sin(2 * np.pi * frequency_hz * np.arange(n)[:, None] / 1000)


def amplitude(frequency_hz: float, parameters: EncoderParameters) -> float:
    """Return the share of a sine that passes, far from either end."""
    middle = low_pass(sine(frequency_hz), parameters)[1000:3000] - LEVEL
    return float(np.sqrt(2) * middle.std() / 0.4)


def with_filter(kind: RaFilter, order: int = 2) -> EncoderParameters:
    return replace(DEFAULT, ra_filter=kind, ra_order=order)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_a_butterworth_passes_what_its_order_says(order: int) -> None:
    causal, both = (with_filter(kind, order) for kind in (RaFilter.CAUSAL, RaFilter.ZERO_PHASE))
    assert amplitude(20, causal) == pytest.approx(0.5**0.5, rel=0.01)
    assert amplitude(20, both) == pytest.approx(0.5, rel=0.01)
    assert amplitude(80, causal) == pytest.approx(1 / np.sqrt(1 + 4 ** (2 * order)), rel=0.2)


def test_the_linear_phase_filter_passes_20_hz_whole_and_stops_at_92() -> None:
    parameters = with_filter(RaFilter.LINEAR_PHASE)
    assert amplitude(20, parameters) == pytest.approx(1.0, abs=0.002)
    assert amplitude(92, parameters) < 10 ** (-58 / 20)
    assert linear_phase_taps(20.0, 1000.0).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("kind", "lags"),
    [(RaFilter.CAUSAL, True), (RaFilter.ZERO_PHASE, False), (RaFilter.LINEAR_PHASE, False)],
)
def test_only_the_causal_filter_lags(kind: RaFilter, lags: bool) -> None:
    at = np.arange(1001)[:, None]
    bump = np.exp(-(((at - 500) / 40.0) ** 2))
    peak = int(low_pass(bump, with_filter(kind))[:, 0].argmax())
    assert (peak > 505) == lags and (peak == 500) != lags


@pytest.mark.parametrize("kind", list(RaFilter))
def test_a_constant_reading_has_no_derivative_from_its_first_sample_on(kind: RaFilter) -> None:
    signals = ra_signals(np.full((300, 2), 0.7), with_filter(kind))
    np.testing.assert_allclose(signals.low_passed, 0.7, atol=1e-12)
    np.testing.assert_allclose(signals.current, 0.0, atol=1e-7)


def test_the_derivative_has_the_unit_that_the_parameters_name() -> None:
    ramp = np.linspace(0, 1, 1001)[:, None]
    per_second = ra_signals(ramp, DEFAULT)
    per_sample = ra_signals(ramp, replace(DEFAULT, ra_derivative=RaDerivative.PER_SAMPLE))
    assert per_second.derivative[-1, 0] == pytest.approx(1.0, rel=1e-6)
    assert per_second.current[-1, 0] == pytest.approx(3.0, rel=1e-6)
    np.testing.assert_allclose(per_sample.derivative, per_second.derivative / 1000)
    np.testing.assert_allclose(per_sample.current, per_second.current / 1000)


@pytest.mark.parametrize("name", [*SA_PRESETS, "ra-absolute"])
def test_whole_trials_have_the_kernels_spikes_with_the_kernels_filter(name: str) -> None:
    """Steps and noise of full width, and a texture: every spike agrees."""
    for samples in (touch(1), extremes(2)):
        kernel = encode_trial(samples, RANGES, PRESETS[name])
        whole = ra_response(samples, RANGES, PRESETS[name]).spikes
        assert whole.sum() > 0
        for taxel in range(N_TAXELS):
            expected = kernel.train(N_TAXELS + taxel)
            np.testing.assert_array_equal(np.repeat(*_train(whole[:, taxel])), expected)


def _train(counts: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.uint8]]:
    return np.arange(len(counts)), counts


@pytest.mark.parametrize("name", WHOLE_TRIALS)
def test_trains_counts_and_membranes_of_whole_trials_agree(name: str) -> None:
    trials = [touch(seed)[:n] for seed, n in enumerate((1500, 0, 1, 7, 900, 1500))]
    edges, parameters = np.array([0, 400, 1000, 1500]), PRESETS[name]
    spikes, usual = encode_trials(trials, RANGES, parameters), encode_trials(trials, RANGES)
    counts = count_spikes(trials, edges, RANGES, parameters)
    for trial, plain, binned in zip(spikes, usual, counts, strict=True):
        for row in range(2 * N_TAXELS):
            np.testing.assert_array_equal(np.histogram(trial.train(row), edges)[0], binned[row])
        for row in range(N_TAXELS):
            np.testing.assert_array_equal(trial.train(row), plain.train(row))
    assert counts[:, N_TAXELS:].sum() > 0
    assert spikes[0].row_start[-1] != usual[0].row_start[-1]
    shown = membrane_mv(trials[0], RANGES, parameters)
    fired = [np.flatnonzero(shown[:, row] == 30.0) for row in range(2 * N_TAXELS)]
    for row, samples in enumerate(fired):
        np.testing.assert_array_equal(samples, np.unique(spikes[0].train(row)))


def test_c_changes_sa_alone_and_some_taxels_are_those_of_all() -> None:
    parameters, edges = PRESETS["ra-zero-phase"], np.array([0, 750, 1500])
    trials, scale = [touch(1), touch(2)], np.full((2, N_TAXELS), 1.5)
    whole = count_spikes(trials, edges, RANGES, parameters)
    plain, with_c = count_spikes_without_and_with_c(trials, edges, RANGES, parameters, scale)
    np.testing.assert_array_equal(plain, whole)
    scaled = count_spikes(trials, edges, RANGES, parameters, sa_scale=scale)
    np.testing.assert_array_equal(scaled[:, :N_TAXELS], with_c)
    np.testing.assert_array_equal(scaled[:, N_TAXELS:], whole[:, N_TAXELS:])
    some = count_spikes(trials, edges, RANGES, parameters, taxels=np.array([3, 0]))
    np.testing.assert_array_equal(some, whole[:, [3, 0, N_TAXELS + 3, N_TAXELS]])


def test_a_derivative_per_sample_leaves_the_gain_of_3_silent() -> None:
    """So the paper's RA spikes speak for a derivative per second."""
    samples = touch(4)
    spikes = encode_trial(samples, RANGES, PRESETS["ra-per-sample"])
    assert spikes.row_start[-1] == spikes.row_start[N_TAXELS] > 0
    louder = replace(PRESETS["ra-per-sample"], ra_gain=3000.0)
    found, usual = encode_trial(samples, RANGES, louder), encode_trial(samples, RANGES)
    np.testing.assert_array_equal(found.sample_index, usual.sample_index)


@pytest.mark.parametrize("name", WHOLE_TRIALS)
def test_a_stream_refuses_a_filter_that_needs_whole_trials(name: str) -> None:
    with pytest.raises(WrongUse, match=f"{name}.*whole trials.*ra_order 2"):
        Encoder(RANGES, PRESETS[name])


def test_readings_are_normalised_as_the_kernel_does() -> None:
    readings = np.array([[0, 50, 512, 710], [2000, 900, 600, 715]], np.uint16)
    ranges = Normalisation(RANGES.low, RANGES.high)
    expected = [[0, 0, 0, 0.5], [1, 1, 0, 0.75]]
    np.testing.assert_allclose(ranges.apply(readings), expected)
