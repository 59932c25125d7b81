"""The force matrix: every C brings the rate to its target, or says why it does not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from rigctl.encoding.force import (
    HIGHEST_C,
    TOLERANCE_HZ,
    ForceMatrix,
    Method,
    Status,
    force_matrix,
    mean_sa_rates_hz,
    search,
)
from rigctl.encoding.normalisation import Normalisation
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
        assert (matrix.status[..., 1] == Status.REFERENCE).all()
        assert (matrix.c[..., 1] == 1).all()
        found = matrix.status[..., [0, 2]]
        assert (found == Status.CONVERGED).mean() > 0.9
        converged = matrix.status == Status.CONVERGED
        assert (abs(matrix.residual_hz[converged]) < TOLERANCE_HZ).all()
        assert (matrix.c[..., 0] > 1).all() and (matrix.c[..., 2] < 1).all()
    matrix = matrices[Method.REGULA_FALSI]
    c = matrix.of("B", 40.0, 250.0)
    target = mean_sa_rates_hz(trials_of("B", 40.0, 500.0), RANGES)
    reached = mean_sa_rates_hz(trials_of("B", 40.0, 250.0), RANGES, c=c)
    np.testing.assert_allclose(reached - target, matrix.residual_hz[1, :, 0, 0], atol=1e-9)


def test_regula_falsi_needs_far_fewer_encodings(matrices: dict[Method, ForceMatrix]) -> None:
    fast, slow = matrices[Method.REGULA_FALSI], matrices[Method.BISECTION]
    both = (fast.status == Status.CONVERGED) & (slow.status == Status.CONVERGED)
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
    assert found.status.tolist() == [Status.CAPPED]
    assert found.c.tolist() == [HIGHEST_C]
    assert found.rate_hz[0] < 150


@pytest.mark.parametrize("method", list(Method))
def test_a_target_between_two_jumps_is_called_that(method: Method) -> None:
    """One trial of 200 ms knows only rates in steps of 5 Hz."""
    short = [np.full((200, 1), 500, np.uint16)]
    found = search(
        short, np.array([42.0]), np.array([1.0]), Normalisation.full_scale(1), method=method
    )
    assert found.status.tolist() == [Status.DISCONTINUITY]
    assert found.rate_hz.tolist() in ([40.0], [45.0])


def test_a_silent_target_and_a_dead_taxel_need_no_search() -> None:
    dead = [np.zeros((500, 2), np.uint16)]
    found = search(dead, np.zeros(2), np.ones(2), Normalisation.full_scale(2))
    assert (found.status == Status.CONVERGED).all()
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
