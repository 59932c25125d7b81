"""The compiled encoder against a textbook one in plain Python, and its other promises."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import signal

from rigctl.encoder.encoder import Encoder, encode_trial, encode_trials, membrane_mv
from rigctl.encoder.kernel import butterworth, constants, neuron_step
from rigctl.encoder.normalisation import Normalisation, RunningRange
from rigctl.encoder.parameters import (
    PRESETS,
    EncoderParameters,
    RaDerivative,
    Recovery,
    Rectify,
    Reset,
    preset,
)
from rigctl.errors import WrongUse

N_TAXELS = 4
RANGES = Normalisation(
    np.array([0, 100, 512, 700], np.uint16), np.array([1023, 900, 512, 720], np.uint16), "test"
)
ALL_PRESETS = sorted(name for name, p in PRESETS.items() if not p.filters_whole_trials)
"""Those that the kernel computes alone; the others are in ``test_ra_filter.py``."""


def textbook_drive(x: list[float], p: EncoderParameters, ra: bool) -> list[float]:
    """Return k·input of each sample: the reading, or the change per second of SciPy's low-pass."""
    if not ra:
        return [p.sa_gain * value for value in x]
    b, a = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    z2 = (b[2] - a[2]) * x[0]
    start = [(b[1] - a[1]) * x[0] + z2, z2]
    smooth, _ = signal.lfilter(b, a, x, zi=start)
    per_sample = np.diff(smooth, prepend=smooth[:1])
    if p.ra_rectify is Rectify.ABSOLUTE:
        per_sample = np.abs(per_sample)
    elif p.ra_rectify is Rectify.RISING_ONLY:
        per_sample = np.maximum(per_sample, 0.0)
    per_unit = 1.0 if p.ra_derivative is RaDerivative.PER_SAMPLE else p.sample_rate_hz
    return [p.ra_gain * per_unit * float(slope) for slope in per_sample]


def textbook_counts(drive: list[float], p: EncoderParameters) -> list[int]:
    """Return the spikes of each sample, with every equation as the paper prints it."""
    v, u, h = p.start_v_mv, p.start_u, p.substep_ms
    counts = []
    for current in drive:
        fired = 0
        late = p.reset is Reset.NEXT_SAMPLE
        if late and v >= p.threshold_mv:
            v, u = p.c_mv, u + p.d
        for _ in range(p.substeps):
            old = v
            v = v + h * (p.quadratic * (v * v) + p.linear * v + p.constant - u + current)
            if not late:
                used = old if p.recovery is Recovery.OLD_V else v
                u = u + h * p.a * (p.b * used - u)
                if v >= p.threshold_mv:
                    v, u, fired = p.c_mv, u + p.d, fired + 1
        if late:
            fired = int(v >= p.threshold_mv)
            v = min(v, p.threshold_mv) if p.clamp_v else v
            u = u + h * p.substeps * (p.a * (p.b * v - u))
        counts.append(fired)
    return counts


def textbook(samples: NDArray[np.uint16], ranges: Normalisation, p: EncoderParameters) -> Any:
    columns = []
    for ra in (False, True):
        for j in range(ranges.n_taxels):
            low, high = int(ranges.low[j]), int(ranges.high[j])
            width = high - low
            clipped = [min(max(int(r), low), high) - low for r in samples[:, j]]
            x = [value * (1 / width) if width else 0.0 for value in clipped]
            columns.append(textbook_counts(textbook_drive(x, p, ra), p))
    return np.array(columns, np.uint8).T


def touch(seed: int, n: int = 1500) -> NDArray[np.uint16]:
    """Return a texture under four taxels, in contact from sample 200 to sample 1,200."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)[:, None] / 1000
    wave = np.sin(2 * np.pi * rng.uniform(5, 40, N_TAXELS) * t + rng.uniform(0, 6, N_TAXELS))
    x = rng.uniform(0.2, 0.7, N_TAXELS) + rng.uniform(0.02, 0.2, N_TAXELS) * wave
    x += rng.normal(0, 0.01, x.shape)
    x[:200] = 0.02
    x[1200:] = 0.02
    return np.round(np.clip(x, 0, 1) * 1023).astype(np.uint16)


def extremes(seed: int) -> NDArray[np.uint16]:
    """Return steps over the whole range, held and flickering, and noise of full width."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.choice([0, 1023], (30, N_TAXELS)), 20, axis=0)
    noise = rng.integers(0, 1024, (300, N_TAXELS))
    flicker = np.tile([[0], [1023]], (100, N_TAXELS))
    return np.concatenate([steps, noise, flicker]).astype(np.uint16)


@pytest.mark.parametrize(("cutoff_hz", "rate_hz"), [(20, 1000), (1, 1000), (499, 1000), (5, 73)])
def test_the_low_pass_is_scipys_butterworth(cutoff_hz: float, rate_hz: float) -> None:
    expected = signal.butter(2, cutoff_hz, fs=rate_hz)
    for ours, theirs in zip(butterworth(cutoff_hz, rate_hz), expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=3e-14)


@pytest.mark.parametrize("name", ALL_PRESETS)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.to_the_bit
def test_spikes_equal_the_textbooks(name: str, seed: int) -> None:
    samples = touch(seed)
    counts = Encoder(RANGES, preset(name)).encode(samples)
    assert counts.sum() > 50
    np.testing.assert_array_equal(counts, textbook(samples, RANGES, preset(name)))


@pytest.mark.parametrize("recovery", list(Recovery))
@pytest.mark.parametrize("rectify", list(Rectify))
@pytest.mark.to_the_bit
def test_extreme_inputs_equal_the_textbooks(recovery: Recovery, rectify: Rectify) -> None:
    p = replace(preset("default"), recovery=recovery, ra_rectify=rectify)
    samples = extremes(5)
    np.testing.assert_array_equal(Encoder(RANGES, p).encode(samples), textbook(samples, RANGES, p))


@pytest.mark.parametrize("seed", range(5))
def test_the_default_scheme_stays_finite(seed: int) -> None:
    voltage = membrane_mv(extremes(seed), RANGES)
    assert np.isfinite(voltage).all()
    assert voltage.min() > -250 and voltage.max() <= 30 + 1e-9


def test_every_parameter_changes_the_spikes() -> None:
    samples = touch(7)
    usual = Encoder(RANGES).encode(samples)
    changes: dict[str, Any] = {
        "a": 0.03, "b": 0.21, "c_mv": -60.0, "d": 7.0, "quadratic": 0.041, "linear": 5.1,
        "constant": 141.0, "threshold_mv": 20.0, "start_v_mv": 20.0, "start_u": -40.0,
        "substeps": 3, "substep_ms": 0.2, "sa_gain": 90.0, "ra_gain": 2.0,
        "ra_lowpass_hz": 10.0, "recovery": Recovery.OLD_V, "reset": Reset.NEXT_SAMPLE,
        "ra_rectify": Rectify.ABSOLUTE, "ra_derivative": RaDerivative.PER_SAMPLE,
        "sample_rate_hz": 900.0,
    }  # fmt: skip
    for key, value in changes.items():
        p = replace(preset("default"), **{key: value})
        counts = Encoder(RANGES, p).encode(samples)
        assert (counts != usual).any(), key
        np.testing.assert_array_equal(counts, textbook(samples, RANGES, p), err_msg=key)
    late = replace(preset("default"), reset=Reset.NEXT_SAMPLE)
    clamped = Encoder(RANGES, replace(late, clamp_v=True)).encode(samples)
    assert (clamped != Encoder(RANGES, late).encode(samples)).any()


def exact_fma(x: float, y: float, z: float) -> float:
    """Return x · y + z in exact rational arithmetic, rounded once."""
    return float(Fraction(x) * Fraction(y) + Fraction(z))


def normal_form(x: list[int], p: EncoderParameters, ra: bool) -> tuple[list[int], list[float]]:
    """Compute spikes and membrane of a lane in the kernel's normal form, step by step."""
    w0, decay, coupling, threshold, reset_to, jump = constants.kernel_constants(p)[:6].tolist()
    a1, a2 = constants.kernel_constants(p)[neuron_step.A1 : neuron_step.A2 + 1].tolist()
    unit = np.array([1 / 1023])
    drive = float(constants.drives(p, unit, np.ones(1))[ra][0])
    m, q = constants.rest_state(p, 32)[: neuron_step.Q + 1, 0].tolist()
    last, z1, z2 = float(x[0]), 0.0, 0.0
    spikes, membrane = [], []
    for reading in map(float, x):
        signal_, fired = reading, 0
        if ra:
            change, last = reading - last, reading
            signal_ = change + z1
            z1 = exact_fma(a1, signal_, (change + change) + z2)
            z2 = exact_fma(a2, signal_, change)
            signal_ = abs(signal_) if p.ra_rectify is Rectify.ABSOLUTE else signal_
        w = exact_fma(drive, signal_, w0)
        for _ in range(p.substeps):
            after = exact_fma(m, m, exact_fma(coupling, q, w))
            q = exact_fma(decay, q, m if p.recovery is Recovery.OLD_V else after)
            crossed = after >= threshold
            m, q, fired = reset_to if crossed else after, q + jump * crossed, fired + crossed
        spikes.append(fired)
        membrane.append(m)
    return spikes, membrane


def published(x: list[int], p: EncoderParameters, ra: bool) -> tuple[list[int], list[float]]:
    """Compute the same for a scheme that resets at the next sample, in the published order."""
    (b0, b1, b2), (_, a1, a2) = butterworth(p.ra_lowpass_hz, p.sample_rate_hz)
    x0 = x[0] * (1 / 1023)
    z2 = (b2 - a2) * x0
    z1 = (b1 - a1) * x0 + z2
    last, v, u = b0 * x0 + z1, p.start_v_mv, p.start_u
    spikes, membrane = [], []
    for value in (reading * (1 / 1023) for reading in x):
        current = p.sa_gain * value
        if ra:
            y = b0 * value + z1
            z1, z2 = (z2 + b1 * value) - a1 * y, b2 * value - a2 * y
            current, last = p.ra_change_gain * (y - last), y
        if v >= p.threshold_mv:
            v, u = p.c_mv, u + p.d
        for _ in range(p.substeps):
            rise = (p.quadratic * (v * v) + p.linear * v) + p.constant
            v = v + p.substep_ms * ((rise - u) + current)
        spikes.append(int(v >= p.threshold_mv))
        v = min(v, p.threshold_mv) if p.clamp_v else v
        u = u + (p.substep_ms * p.substeps) * (p.a * (p.b * v - u))
        membrane.append(v)
    return spikes, membrane


@pytest.mark.parametrize("name", ALL_PRESETS)
@pytest.mark.to_the_bit
def test_compiled_arithmetic_has_the_bits_of_exact_arithmetic(name: str) -> None:
    """Every operation is rounded once, in order: all bits of every voltage agree."""
    p, ranges = preset(name), Normalisation.full_scale(N_TAXELS)
    samples = np.concatenate([touch(3, 250)[100:], extremes(3)[:150]])
    counts, voltage = Encoder(ranges, p).encode(samples), membrane_mv(samples, ranges, p)
    compute = published if constants.has_late_reset(p) else normal_form
    for column in range(2 * N_TAXELS):
        readings = samples[:, column % N_TAXELS].tolist()
        spikes, membrane = compute(readings, p, column >= N_TAXELS)
        assert counts[:, column].tolist() == spikes
        expected = constants.membrane_mv(p, np.array(membrane))
        expected[counts[:, column] > 0] = p.threshold_mv
        assert voltage[:, column].tobytes() == expected.tobytes()


@pytest.mark.to_the_bit
def test_trains_equal_brian2s() -> None:
    """Spikes of Brian2's forward Euler; ``golden.py`` writes them."""
    with np.load(Path(__file__).with_name("brian2_explicit.npz")) as golden:
        samples, neuron, sample = golden["samples"], golden["neuron"], golden["sample"]
        assert "Brian2 2.9" in str(golden["made_by"])
    ranges = Normalisation.full_scale(samples.shape[2])
    spikes = encode_trials(list(samples), ranges, preset("explicit"))
    ours = [trial.train(row) for trial in spikes for row in range(trial.n_trains)]
    assert sum(map(len, ours)) == len(sample) > 3000
    for index, train in enumerate(ours):
        np.testing.assert_array_equal(train, sample[neuron == index])


@settings(max_examples=40, deadline=None)
@given(cuts=st.lists(st.integers(0, 1500), max_size=12), name=st.sampled_from(ALL_PRESETS))
@pytest.mark.to_the_bit
def test_any_slicing_gives_the_same_spikes(cuts: list[int], name: str) -> None:
    samples = touch(11)
    whole = Encoder(RANGES, preset(name)).encode(samples)
    encoder = Encoder(RANGES, preset(name))
    pieces = [encoder.encode(part) for part in np.split(samples, sorted(cuts))]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


@pytest.mark.to_the_bit
def test_live_equals_offline_for_trials_of_any_length() -> None:
    trials = [touch(seed)[: 100 + 211 * seed] for seed in range(6)] + [touch(9)[:0], touch(8)[:1]]
    batched = encode_trials(trials * 8, RANGES)
    live = Encoder(RANGES)
    for samples, spikes in zip(trials * 8, batched, strict=True):
        live.reset()
        counts = live.encode(samples)
        assert spikes.n_samples == len(samples)
        for row in range(2 * N_TAXELS):
            expected = np.repeat(np.arange(len(samples)), counts[:, row])
            np.testing.assert_array_equal(spikes.train(row), expected)


@pytest.mark.to_the_bit
def test_a_reset_clears_all_state() -> None:
    encoder = Encoder(RANGES)
    first = encoder.encode(touch(1)[:700])
    encoder.encode(extremes(2))
    encoder.reset()
    np.testing.assert_array_equal(encoder.encode(touch(1)[:700]), first)


@pytest.mark.to_the_bit
def test_noncontiguous_samples_give_the_same_spikes() -> None:
    wide = np.repeat(touch(4), 2, axis=1)
    np.testing.assert_array_equal(
        Encoder(RANGES).encode(wide[:, ::2]), Encoder(RANGES).encode(touch(4))
    )


def test_several_spikes_in_a_sample_are_kept() -> None:
    ranges = Normalisation.full_scale(1)
    strong = replace(preset("default"), sa_gain=5000.0)
    samples = np.full((50, 1), 1023, np.uint16)
    spikes = encode_trial(samples, ranges, strong)
    counts = Encoder(ranges, strong).encode(samples)
    assert counts[:, 0].max() > 1
    assert len(spikes.train(0)) == counts[:, 0].sum()


def test_sa_scale_is_a_factor_on_the_sa_current_only() -> None:
    samples = touch(2)
    scale = np.array([[1.0, 0.5, 2.0, 5.0]])
    scaled = encode_trials([samples], RANGES, sa_scale=scale)[0]
    for j in range(N_TAXELS):
        p = replace(preset("default"), sa_gain=100.0 * scale[0, j])
        alone = encode_trial(samples, RANGES, p)
        np.testing.assert_array_equal(scaled.train(j), alone.train(j))
        plain = encode_trial(samples, RANGES)
        np.testing.assert_array_equal(scaled.train(N_TAXELS + j), plain.train(N_TAXELS + j))


def test_readings_outside_the_range_are_clipped_and_counted() -> None:
    inside = np.array([[0, 100, 512, 700], [1023, 900, 512, 720]], np.uint16)
    outside = np.array([[0, 50, 511, 0], [1023, 1000, 513, 1023]], np.uint16)
    narrow, wide = Encoder(RANGES), Encoder(RANGES)
    a, b = narrow.encode(np.tile(inside, (200, 1))), wide.encode(np.tile(outside, (200, 1)))
    np.testing.assert_array_equal(a, b)
    assert narrow.clipped_counts.tolist() == [0, 0, 0, 0]
    assert wide.clipped_counts.tolist() == [0, 400, 400, 400]


def test_a_constant_taxel_is_silent_and_named() -> None:
    assert RANGES.constant_taxels == [3]
    assert Encoder(RANGES).encode(extremes(1))[:, [2, 6]].sum() == 0


def test_the_running_range_only_widens() -> None:
    running = RunningRange(2)
    assert running.normalisation.high.tolist() == [1023, 1023]
    assert running.update(np.array([[5, 9], [7, 3]], np.uint16))
    assert not running.update(np.array([[6, 4]], np.uint16))
    assert running.update(np.array([[8, 4]], np.uint16))
    assert (running.normalisation.low.tolist(), running.normalisation.high.tolist()) == (
        [5, 3],
        [8, 9],
    )
    assert "running" in running.normalisation.source


def test_a_running_range_of_noise_alone_keeps_the_neurons_quiet() -> None:
    rng = np.random.default_rng(2)
    idle = rng.integers(30, 34, (3000, 2)).astype(np.uint16)
    running = RunningRange(2, min_width=128)
    running.update(idle)
    assert running.normalisation.high.tolist() == [158, 158]
    assert Encoder(running.normalisation).encode(idle).sum() == 0


def test_constant_readings_never_drive_the_ra_channel() -> None:
    samples = np.full((3000, 1), 777, np.uint16)
    spikes = encode_trial(samples, Normalisation.full_scale(1))
    assert len(spikes.train(0)) > 100
    assert len(spikes.train(1)) == 0


def test_a_neuron_at_rest_stays_there() -> None:
    voltage = membrane_mv(np.zeros((5000, 1), np.uint16), Normalisation.full_scale(1))
    np.testing.assert_allclose(voltage, -70.0, atol=1e-9)


def test_samples_of_another_width_are_refused() -> None:
    with pytest.raises(WrongUse, match="4 taxels"):
        Encoder(RANGES).encode(np.zeros((5, 18), np.uint16))
