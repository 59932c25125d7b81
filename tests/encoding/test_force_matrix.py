"""The force matrix: every C brings the rate to its target, or says why it does not."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigctl.encoding.batch import mean_level
from rigctl.encoding.force_matrix import ForceMatrix, force_matrix
from rigctl.encoding.force_search import (
    FEWEST_IN_PILOT,
    PILOT_EVERY,
    TOLERANCE_HZ,
    ForceSearch,
    mean_sa_rates_hz,
    search,
    search_to,
)
from rigctl.encoding.normalisation import Normalisation
from rigctl.encoding.root_bracket import HIGHEST_C, Bracket, Method, SearchStatus
from rigctl.errors import WrongUse

N_TAXELS = 6
RANGES = Normalisation.full_scale(N_TAXELS)
FORCES = (250.0, 500.0, 1000.0)

Trials = list[NDArray[np.uint16]]


def trials_of(texture: str, speed: float, force: float) -> Trials:
    """Twenty noisy trials; a taxel reads higher under more force, each in its own measure."""
    rng = np.random.default_rng([ord(texture), int(speed), int(force)])
    n = round(60_000 / speed)
    gain = np.linspace(0.25, 0.5, N_TAXELS) * (force / 500) ** np.linspace(0.3, 0.7, N_TAXELS)
    wave = 1 + 0.4 * np.sin(2 * np.pi * 0.2 * speed * np.arange(n)[:, None] / 1000 + ord(texture))
    noise = rng.normal(0, 0.01, (20, n, N_TAXELS))
    return list(np.round(1023 * np.clip(gain * wave + noise, 0, 1)).astype(np.uint16))


@pytest.fixture(scope="module")
def matrices() -> dict[Method, ForceMatrix]:
    return {
        method: force_matrix(trials_of, "AB", (40.0, 120.0), FORCES, RANGES, method=method)
        for method in Method
    }


def test_every_c_brings_the_rate_to_its_target(matrices: dict[Method, ForceMatrix]) -> None:
    for matrix in matrices.values():
        assert matrix.c.shape == (2, N_TAXELS, 2, 3)
        assert (matrix.status[..., 1] == SearchStatus.REFERENCE).all()
        assert (matrix.c[..., 1] == 1).all()
        found = matrix.status[..., [0, 2]]
        assert (found == SearchStatus.CONVERGED).mean() > 0.9
        converged = matrix.status == SearchStatus.CONVERGED
        assert (abs(matrix.residual_hz[converged]) < TOLERANCE_HZ).all()
        assert (matrix.c[..., 0] > 1).all() and (matrix.c[..., 2] < 1).all()
    matrix = matrices[Method.REGULA_FALSI]
    c = matrix.of("B", 40.0, 250.0)
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
    mean = (matrix.of("A", 120.0, 1000.0) + matrix.of("B", 120.0, 1000.0)) / 2
    np.testing.assert_allclose(matrix.texture_blind(120.0, 1000.0), mean)
    for call in (lambda: matrix.of("Z", 40.0, 250.0), lambda: matrix.texture_blind(50.0, 250.0)):
        with pytest.raises(WrongUse, match="force matrix"):
            call()


@pytest.mark.parametrize("method", list(Method))
def test_a_taxel_too_weak_for_its_target_is_capped(method: Method) -> None:
    weak = [np.full((2000, 1), 20, np.uint16)] * 3
    found = search(
        weak, np.array([150.0]), np.array([30.0]), Normalisation.full_scale(1), method=method
    )
    assert found.status.tolist() == [SearchStatus.CAPPED]
    assert found.c.tolist() == [HIGHEST_C]
    assert found.rate_hz[0] < 150


@pytest.mark.parametrize("method", list(Method))
def test_a_target_between_two_jumps_is_called_that(method: Method) -> None:
    """One trial of 200 ms knows only rates in steps of 5 Hz."""
    short = [np.full((200, 1), 500, np.uint16)]
    found = search(
        short, np.array([42.0]), np.array([1.0]), Normalisation.full_scale(1), method=method
    )
    assert found.status.tolist() == [SearchStatus.DISCONTINUITY]
    assert found.rate_hz.tolist() in ([40.0], [45.0])


def test_a_silent_target_and_a_dead_taxel_need_no_search() -> None:
    dead = [np.zeros((500, 2), np.uint16)]
    found = search(dead, np.zeros(2), np.ones(2), Normalisation.full_scale(2))
    assert (found.status == SearchStatus.CONVERGED).all()
    assert found.evaluations.tolist() == [1, 1]


def missing_force(texture: str, speed: float, force: float) -> Trials:
    return [] if force == 1000.0 else trials_of(texture, speed, force)


@pytest.mark.parametrize(
    ("source", "forces", "words"),
    [
        (trials_of, (250.0, 1000.0), "reference force of 500 g"),
        (missing_force, FORCES, "no trial of texture A at 120 mm/s and 1000 g"),
    ],
)
def test_missing_conditions_are_named(
    source: Callable[[str, float, float], Trials], forces: tuple[float, ...], words: str
) -> None:
    with pytest.raises(WrongUse, match=words):
        force_matrix(source, "A", (120.0,), forces, RANGES)


RESTLESS = PILOT_EVERY * FEWEST_IN_PILOT
"""Trials of a condition that are enough for some to be asked first."""


def searched(
    trials: Trials, reference: Trials, method: Method = Method.REGULA_FALSI
) -> ForceSearch:
    ranges = Normalisation.full_scale(trials[0].shape[1])
    target = mean_sa_rates_hz(reference, ranges)
    return search_to(trials, mean_level(reference, ranges), target, ranges, method=method)


def pressed(force: float, n: int, spread: float, seed: int = 0) -> Trials:
    """Trials uint16 (n_i, 3) of one condition that read more or less high, and are not as long."""
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


@pytest.mark.parametrize("n", [1, RESTLESS - 1, RESTLESS, 4 * RESTLESS])
@pytest.mark.parametrize("force", [250.0, 1000.0])
def test_c_is_told_by_all_trials_however_few_are_asked_first(n: int, force: float) -> None:
    trials, reference = pressed(force, n, 0.03), pressed(500.0, n, 0.03)
    found = searched(trials, reference)
    ranges = Normalisation.full_scale(3)
    reached = mean_sa_rates_hz(trials, ranges, c=found.c)
    np.testing.assert_array_equal(reached, found.rate_hz)
    miss = abs(reached - mean_sa_rates_hz(reference, ranges))
    assert (miss[found.status == SearchStatus.CONVERGED] < TOLERANCE_HZ).all()
    assert n == 1 or (found.status == SearchStatus.CONVERGED).all()
    lengths = np.array([len(trial) for trial in trials])
    rates = (found.counts.sum(axis=2) / lengths[:, None]).mean(axis=0) * 1000
    np.testing.assert_allclose(rates, reached)


def test_asking_some_trials_first_saves_encodings_and_counts_them() -> None:
    trials, reference = pressed(250.0, 100, 0.02), pressed(500.0, 100, 0.02)
    with_some = searched(trials, reference).evaluations
    share = sum(map(len, trials[PILOT_EVERY // 2 :: PILOT_EVERY])) / sum(map(len, trials))
    asked = with_some % 1 / share
    np.testing.assert_allclose(asked, np.round(asked), atol=1e-9)
    assert (np.round(asked) >= 1).all()
    alone = searched(trials[: RESTLESS - 1], reference).evaluations
    np.testing.assert_array_equal(alone, np.round(alone))
    assert with_some.mean() < alone.mean()


@pytest.mark.parametrize("odd", [0.4, 2.5])
def test_trials_asked_first_that_are_unlike_the_rest_mislead_nobody(odd: float) -> None:
    """They read much higher or lower, and in bursts: making up for their level does not help."""
    trials, reference = pressed(250.0, 64, 0.02), pressed(500.0, 64, 0.02)
    for i in range(PILOT_EVERY // 2, 64, PILOT_EVERY):
        bursts = np.where(np.arange(len(trials[i])) // 50 % 2, odd, 0.1)[:, None]
        trials[i] = np.minimum(trials[i] * bursts, 1023).astype(np.uint16)
    found = searched(trials, reference)
    sure = searched(trials, reference, Method.BISECTION)
    assert found.status.tolist() == sure.status.tolist() == [SearchStatus.CONVERGED] * 3
    np.testing.assert_allclose(found.c, sure.c, rtol=0.02)


def test_a_jump_has_the_same_nearer_side_whoever_is_asked_first() -> None:
    """Equal trials of 200 ms know only rates in steps of 5 Hz."""
    short = [np.full((200, 1), 500, np.uint16)] * RESTLESS
    ranges, target = Normalisation.full_scale(1), np.array([42.0])
    ends = [
        search(some, target, np.ones(1), ranges, method=method)
        for some in (short, short[:1])
        for method in Method
    ]
    assert {end.status.item() for end in ends} == {SearchStatus.DISCONTINUITY}
    assert {end.rate_hz.item() for end in ends} == {40.0}


def test_a_cap_is_told_by_all_trials() -> None:
    """Those asked first are too weak for the target, or strong enough where the others are not."""
    ranges, target = Normalisation.full_scale(1), np.array([98.9])
    weak, strong = np.full((1000, 1), 20, np.uint16), np.full((1000, 1), 400, np.uint16)
    asked = range(PILOT_EVERY // 2, RESTLESS, PILOT_EVERY)
    mixed = [weak if i in asked else strong for i in range(RESTLESS)]
    found = search(mixed, target, np.ones(1), ranges)
    assert found.status.item() == SearchStatus.CONVERGED
    found = search(
        [strong if i in asked else weak for i in range(RESTLESS)], target, target, ranges
    )
    assert (found.status.item(), found.c.item()) == (SearchStatus.CAPPED, HIGHEST_C)


@given(
    target=st.floats(0, 200),
    start=st.floats(0, 10),
    slope=st.none() | st.floats(-10, 1e4),
    gain=st.floats(1, 500),
    threshold=st.floats(0, 6),
    step=st.sampled_from([0.0, 0.01, 3.0, 20.0]),
    method=st.sampled_from(Method),
)
def test_every_search_ends_and_tells_the_truth(
    target: float,
    start: float,
    slope: float | None,
    gain: float,
    threshold: float,
    step: float,
    method: Method,
) -> None:
    """The rate rises from a threshold on, smoothly or in steps; the slope said may be a lie."""

    def rate(c: float) -> float:
        smooth = gain * max(0.0, c - threshold)
        return math.floor(smooth / step) * step if step else smooth

    bracket = Bracket(target, start, method, slope)
    guesses = []
    while bracket.status is None and len(guesses) < 60:
        assert 0 <= bracket.guess <= HIGHEST_C
        guesses.append(bracket.guess)
        bracket.learn(rate(bracket.guess), TOLERANCE_HZ)
    assert bracket.status is not None
    assert bracket.best_c in guesses
    assert bracket.best_rate == rate(bracket.best_c)
    assert bracket.evaluations == len(guesses) == len(set(guesses))
    miss = abs(bracket.best_rate - target)
    if bracket.status is SearchStatus.CONVERGED:
        assert miss < TOLERANCE_HZ
    if bracket.status is SearchStatus.CAPPED:
        assert rate(HIGHEST_C) < target
    if bracket.status is SearchStatus.DISCONTINUITY:
        assert miss <= step
