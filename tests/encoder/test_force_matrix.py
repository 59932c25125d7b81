"""The force matrix: every C brings the rate to its target, or its status explains why not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.encoder.batch import mean_normalised_reading
from rigctl.encoder.force_matrix import ForceMatrix
from rigctl.encoder.force_search import (
    MIN_PILOT_TRIALS,
    PILOT_STRIDE,
    TOLERANCE_HZ,
    ForceSearch,
    mean_sa_rates_hz,
    search_c,
)
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.root_bracket import HIGHEST_C, LIMIT_C, Bracket, Method, SearchStatus
from rigctl.errors import WrongUse

N_TAXELS = 6
RANGES = Normalisation.full_scale(N_TAXELS)
FORCES = (250.0, 500.0, 1000.0)

WITH_PILOT = PILOT_STRIDE * MIN_PILOT_TRIALS
"""Fewest trials of a condition that has a pilot."""

Trials = list[NDArray[np.uint16]]


def trials_of(texture: str, speed: float, force: float) -> Trials:
    """Twenty noisy trials; a taxel reads higher under more force, each by its own factor."""
    rng = np.random.default_rng([ord(texture), int(speed), int(force)])
    n = round(60_000 / speed)
    gain = np.linspace(0.25, 0.5, N_TAXELS) * (force / 500) ** np.linspace(0.3, 0.7, N_TAXELS)
    wave = 1 + 0.4 * np.sin(2 * np.pi * 0.2 * speed * np.arange(n)[:, None] / 1000 + ord(texture))
    noise = rng.normal(0, 0.01, (20, n, N_TAXELS))
    return list(np.round(1023 * np.clip(gain * wave + noise, 0, 1)).astype(np.uint16))


def search(trials: Trials, reference: Trials, method: Method = Method.REGULA_FALSI) -> ForceSearch:
    ranges = Normalisation.full_scale(trials[0].shape[1])
    target = mean_sa_rates_hz(reference, ranges)
    return search_c(
        trials, mean_normalised_reading(reference, ranges), target, ranges, method=method
    )


def search_from(
    start: float, trials: Trials, target_hz: float, method: Method = Method.REGULA_FALSI
) -> ForceSearch:
    """Search C from a first guess, with one target for all taxels."""
    ranges = Normalisation.full_scale(trials[0].shape[1])
    reading = mean_normalised_reading(trials, ranges)
    return search_c(
        trials, start * reading, np.full_like(reading, target_hz), ranges, method=method
    )


def search_matrix(method: Method) -> ForceMatrix:
    """Search C of two textures at two speeds and all forces."""
    textures, speeds = ("A", "B"), (40.0, 120.0)
    shape = (len(textures), N_TAXELS, len(speeds), len(FORCES))
    c, status = np.ones(shape), np.zeros(shape, np.int8)
    residual, evaluations = np.zeros(shape), np.zeros(shape)
    for t, v, f in np.ndindex(len(textures), len(speeds), len(FORCES)):
        if FORCES[f] == 500.0:
            continue
        reference = trials_of(textures[t], speeds[v], 500.0)
        result = search(trials_of(textures[t], speeds[v], FORCES[f]), reference, method)
        at = np.s_[t, :, v, f]
        c[at], status[at], evaluations[at] = result.c, result.status, result.evaluations
        residual[at] = result.rate_hz - mean_sa_rates_hz(reference, RANGES)
    return ForceMatrix(textures, speeds, FORCES, 500.0, c, status, residual, evaluations)


@pytest.fixture(scope="module")
def matrices() -> dict[Method, ForceMatrix]:
    return {method: search_matrix(method) for method in Method}


def test_every_c_brings_the_rate_to_its_target(matrices: dict[Method, ForceMatrix]) -> None:
    for matrix in matrices.values():
        assert matrix.c.shape == (2, N_TAXELS, 2, 3)
        assert (matrix.status[..., 1] == SearchStatus.REFERENCE).all()
        assert (matrix.c[..., 1] == 1).all()
        result = matrix.status[..., [0, 2]]
        assert (result == SearchStatus.CONVERGED).mean() > 0.9
        converged = matrix.status == SearchStatus.CONVERGED
        assert (abs(matrix.residual_hz[converged]) < TOLERANCE_HZ).all()
        assert (matrix.c[..., 0] > 1).all() and (matrix.c[..., 2] < 1).all()
    matrix = matrices[Method.REGULA_FALSI]
    c = matrix.c_at("B", 40.0, 250.0)
    target = mean_sa_rates_hz(trials_of("B", 40.0, 500.0), RANGES)
    reached = mean_sa_rates_hz(trials_of("B", 40.0, 250.0), RANGES, c=c)
    np.testing.assert_allclose(reached - target, matrix.residual_hz[1, :, 0, 0], atol=1e-9)


def test_regula_falsi_needs_far_fewer_encodings(matrices: dict[Method, ForceMatrix]) -> None:
    fast, slow = matrices[Method.REGULA_FALSI], matrices[Method.BISECTION]
    both = (fast.status == SearchStatus.CONVERGED) & (slow.status == SearchStatus.CONVERGED)
    assert fast.evaluations[both].mean() < 4
    assert slow.evaluations[both].mean() > 2.5 * fast.evaluations[both].mean()
    np.testing.assert_allclose(fast.c[both], slow.c[both], rtol=0.05)


def test_texture_blind_c_is_the_mean_over_textures(matrices: dict[Method, ForceMatrix]) -> None:
    matrix = matrices[Method.REGULA_FALSI]
    mean = (matrix.c_at("A", 120.0, 1000.0) + matrix.c_at("B", 120.0, 1000.0)) / 2
    np.testing.assert_allclose(matrix.texture_blind(120.0, 1000.0), mean)
    for call in (lambda: matrix.c_at("Z", 40.0, 250.0), lambda: matrix.texture_blind(50.0, 250.0)):
        with pytest.raises(WrongUse, match="force matrix"):
            call()


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize("n", [3, WITH_PILOT])
def test_a_weak_taxel_that_reaches_its_target_keeps_a_c_above_five(method: Method, n: int) -> None:
    """Only a search that does not converge is limited to 5 (Materials and Methods)."""
    heights = np.linspace(18, 22, n)
    weak = [np.full((2000, 1), round(height), np.uint16) for height in heights]
    reference = [trial * 10 for trial in weak]
    result = search(weak, reference, method)
    assert result.status.tolist() == [SearchStatus.CONVERGED]
    assert result.c[0] == pytest.approx(10.0, rel=0.01)
    target = mean_sa_rates_hz(reference, Normalisation.full_scale(1))
    assert abs(result.rate_hz - target) < TOLERANCE_HZ


@pytest.mark.parametrize("method", list(Method))
@pytest.mark.parametrize(
    ("reading", "seconds", "target_hz"),
    [(20, 2.0, 5000.0), (0, 2.0, 30.0), (20, 0.2, 42.0)],
    ids=["more than a neuron can fire", "a dead taxel", "a jump above 5"],
)
def test_a_c_above_five_that_does_not_converge_is_five(
    reading: int, seconds: float, target_hz: float, method: Method
) -> None:
    trials = [np.full((round(1000 * seconds), 1), reading, np.uint16)]
    result = search_from(30.0, trials, target_hz, method)
    assert result.status.tolist() == [SearchStatus.CAPPED]
    assert result.c.tolist() == [LIMIT_C]
    at_five = mean_sa_rates_hz(trials, Normalisation.full_scale(1), c=result.c)
    assert result.rate_hz.tolist() == at_five.tolist()
    assert result.counts.sum() == pytest.approx(at_five[0] * seconds)


@pytest.mark.parametrize("method", list(Method))
def test_a_target_between_two_jumps_is_a_discontinuity(method: Method) -> None:
    """One trial of 200 ms has only rates in steps of 5 Hz."""
    short = [np.full((200, 1), 500, np.uint16)]
    result = search_from(1.0, short, 42.0, method)
    assert result.status.tolist() == [SearchStatus.DISCONTINUITY]
    assert result.rate_hz.tolist() in ([40.0], [45.0])


def test_a_silent_target_and_a_dead_taxel_need_no_search() -> None:
    dead = [np.zeros((500, 2), np.uint16)]
    result = search_from(1.0, dead, 0.0)
    assert (result.status == SearchStatus.CONVERGED).all()
    assert result.evaluations.tolist() == [1, 1]


def pressed(force: float, n: int, spread: float, seed: int = 0) -> Trials:
    """Trials uint16 (n_i, 3) of one condition, of different heights and lengths."""
    rng = np.random.default_rng([seed, round(force)])
    level = 0.35 * (force / 500) ** np.array([0.3, 0.5, 0.7])
    heights = level * (1 + spread * rng.normal(size=(n, 1, 1)))
    wave = 1 + 0.3 * np.sin(np.arange(700)[:, None] / 30 + np.arange(3))
    readings = np.clip(heights * wave + rng.normal(0, 0.01, (n, 700, 3)), 0, 1)
    lengths = rng.integers(600, 700, n)
    return [
        np.round(1023 * one[:length]).astype(np.uint16)
        for one, length in zip(readings, lengths, strict=True)
    ]


@pytest.mark.parametrize("n", [1, WITH_PILOT - 1, WITH_PILOT, 4 * WITH_PILOT])
@pytest.mark.parametrize("force", [250.0, 1000.0])
def test_all_trials_decide_c_with_and_without_a_pilot(n: int, force: float) -> None:
    trials, reference = pressed(force, n, 0.03), pressed(500.0, n, 0.03)
    result = search(trials, reference)
    ranges = Normalisation.full_scale(3)
    reached = mean_sa_rates_hz(trials, ranges, c=result.c)
    np.testing.assert_array_equal(reached, result.rate_hz)
    miss = abs(reached - mean_sa_rates_hz(reference, ranges))
    assert (miss[result.status == SearchStatus.CONVERGED] < TOLERANCE_HZ).all()
    assert n == 1 or (result.status == SearchStatus.CONVERGED).all()
    lengths = np.array([len(trial) for trial in trials])
    rates = (result.counts.sum(axis=2) / lengths[:, None]).mean(axis=0) * 1000
    np.testing.assert_allclose(rates, reached)


def test_a_pilot_saves_encodings_and_counts_its_own() -> None:
    trials, reference = pressed(250.0, 100, 0.02), pressed(500.0, 100, 0.02)
    with_pilot = search(trials, reference).evaluations
    share = sum(map(len, trials[PILOT_STRIDE // 2 :: PILOT_STRIDE])) / sum(map(len, trials))
    rounds = with_pilot % 1 / share
    np.testing.assert_allclose(rounds, np.round(rounds), atol=1e-9)
    assert (np.round(rounds) >= 1).all()
    alone = search(trials[: WITH_PILOT - 1], reference).evaluations
    np.testing.assert_array_equal(alone, np.round(alone))
    assert with_pilot.mean() < alone.mean()


@pytest.mark.parametrize("odd", [0.4, 2.5])
def test_a_pilot_unlike_the_other_trials_does_not_mislead(odd: float) -> None:
    """It reads much higher or lower, and in bursts: a correction of its mean does not help."""
    trials, reference = pressed(250.0, 64, 0.02), pressed(500.0, 64, 0.02)
    for i in range(PILOT_STRIDE // 2, 64, PILOT_STRIDE):
        bursts = np.where(np.arange(len(trials[i])) // 50 % 2, odd, 0.1)[:, None]
        trials[i] = np.minimum(trials[i] * bursts, 1023).astype(np.uint16)
    result = search(trials, reference)
    sure = search(trials, reference, Method.BISECTION)
    assert result.status.tolist() == sure.status.tolist() == [SearchStatus.CONVERGED] * 3
    np.testing.assert_allclose(result.c, sure.c, rtol=0.02)


def test_a_jump_has_the_same_nearer_side_with_and_without_a_pilot() -> None:
    """Equal trials of 200 ms have only rates in steps of 5 Hz."""
    short = [np.full((200, 1), 500, np.uint16)] * WITH_PILOT
    ends = [
        search_from(1.0, some, 42.0, method) for some in (short, short[:1]) for method in Method
    ]
    assert {end.status.item() for end in ends} == {SearchStatus.DISCONTINUITY}
    assert {end.rate_hz.item() for end in ends} == {40.0}


def test_all_trials_decide_a_cap() -> None:
    """The pilot is too weak for the target, or strong enough where the others are not."""
    weak, strong = np.full((1000, 1), 20, np.uint16), np.full((1000, 1), 400, np.uint16)
    pilot = range(PILOT_STRIDE // 2, WITH_PILOT, PILOT_STRIDE)
    mixed = [weak if i in pilot else strong for i in range(WITH_PILOT)]
    result = search_from(1.0, mixed, 98.9)
    assert result.status.item() == SearchStatus.CONVERGED
    dead = np.zeros_like(weak)
    mixed = [strong if i in pilot else dead for i in range(WITH_PILOT)]
    result = search_from(98.9, mixed, 1000.0)
    assert (result.status.item(), result.c.item()) == (SearchStatus.CAPPED, LIMIT_C)


@given(
    target=st.floats(0, 200),
    start=st.floats(0, 10),
    slope=st.none() | st.floats(-10, 1e4),
    gain=st.floats(1, 500),
    threshold=st.floats(0, 20),
    step=st.sampled_from([0.0, 0.01, 3.0, 20.0]),
    method=st.sampled_from(Method),
)
def test_every_search_ends_with_a_true_status(
    target: float,
    start: float,
    slope: float | None,
    gain: float,
    threshold: float,
    step: float,
    method: Method,
) -> None:
    """The rate rises from a threshold on, smoothly or in steps; the given slope may be wrong."""

    def rate(c: float) -> float:
        smooth = gain * max(0.0, c - threshold)
        return math.floor(smooth / step) * step if step else smooth

    bracket = Bracket(target, start, method, slope)
    guesses = []
    while bracket.status is None and len(guesses) < 60:
        assert 0 <= bracket.guess <= HIGHEST_C
        guesses.append(bracket.guess)
        bracket.update(rate(bracket.guess), TOLERANCE_HZ)
    assert bracket.status is not None
    assert bracket.best_c in guesses
    assert bracket.best_rate == rate(bracket.best_c)
    assert bracket.evaluations == len(guesses) == len(set(guesses))
    miss = abs(bracket.best_rate - target)
    if bracket.status is SearchStatus.CONVERGED:
        assert miss < TOLERANCE_HZ
    if bracket.status is SearchStatus.CAPPED:
        assert bracket.best_c == LIMIT_C and rate(LIMIT_C) < target
        assert step > 0 or rate(HIGHEST_C) < target
    if bracket.status is SearchStatus.DISCONTINUITY:
        assert miss <= step
    assert bracket.best_c <= LIMIT_C or bracket.status is SearchStatus.CONVERGED
