"""Benchmark the search of C against bisection with the same kernel, on waves at two forces."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from rigctl.encoder.batch import Floats, mean_normalised_reading
from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.force_search import ForceSearch, mean_sa_rates_hz, search_c
from rigctl.encoder.kernel import Trials
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.root_bracket import Method, SearchStatus
from tests.benchmarks.encoder._peers import row

TEXTURES, SPEEDS_MM_S, FORCES_G = (0, 1), (80.0, 120.0), (250.0, 1000.0)
N_TRIALS, TRAVEL_MM, N_TAXELS = 100, 240.0, 18
Condition = tuple[Trials, Floats, Floats]
RANGES = Normalisation.full_scale(N_TAXELS)
SCENE = (
    "2 textures x 2 speeds x 2 forces x 18 taxels, 100 trials each, tolerance 0.1 Hz, one thread"
)


def measure() -> Iterator[dict[str, Any]]:
    """Yield the time of both searches, with their numbers of encodings."""
    conditions = [
        (generate_trials(texture, speed, force), *target(texture, speed))
        for texture in TEXTURES
        for speed in SPEEDS_MM_S
        for force in FORCES_G
    ]
    search_all(conditions[:1], Method.REGULA_FALSI)  # compiles
    ours, ours_s = search_all(conditions, Method.REGULA_FALSI)
    theirs, theirs_s = search_all(conditions, Method.BISECTION)
    note = f"{SCENE}; ours {describe(ours)}; bisection {describe(theirs)}"
    yield row("force_search.vs_bisection", ours_s, "s", "bisection of [0, 5]", theirs_s, note)


def target(texture: int, speed_mm_s: float) -> tuple[Floats, Floats]:
    """Return rates and levels at 500 g, the targets of both searches."""
    trials = generate_trials(texture, speed_mm_s, REFERENCE_FORCE_G)
    return mean_sa_rates_hz(trials, RANGES), mean_normalised_reading(trials, RANGES)


def generate_trials(texture: int, speed_mm_s: float, force_g: float) -> Trials:
    """Return trials, uint16 (n, 18): a level that saturates with force, and a wave on it."""
    rng = np.random.default_rng([texture, round(speed_mm_s), round(force_g)])
    n = round(1000 * TRAVEL_MM / speed_mm_s)
    travel = speed_mm_s * np.arange(n)[:, None] / 1000
    level = np.random.default_rng(texture).uniform(0.25, 0.45, N_TAXELS)
    level = level * (force_g / 500) ** 0.55
    wave = 0.3 * np.sin(2 * np.pi * travel / (4 + 2 * texture) + np.arange(N_TAXELS))
    return [
        np.round(
            1023 * np.clip(level * (1 + wave) + rng.normal(0, 0.01, (n, N_TAXELS)), 0, 1)
        ).astype(np.uint16)
        for _ in range(N_TRIALS)
    ]


def search_all(conditions: list[Condition], method: Method) -> tuple[list[ForceSearch], float]:
    """Return C of every condition and the wall time, s, which includes finding the start."""
    start_s = time.perf_counter()
    found = []
    for trials, target_hz, goal in conditions:
        found.append(search_c(trials, goal, target_hz, RANGES, method=method))
    return found, time.perf_counter() - start_s


def describe(found: list[ForceSearch]) -> str:
    """Return mean encodings per entry, partial ones by their share, and the failures."""
    evaluations = np.concatenate([one.evaluations for one in found])
    failed = sum(int((one.status != SearchStatus.CONVERGED).sum()) for one in found)
    return f"{evaluations.mean():.2f} encodings an entry, {failed} not converged"
