"""The force search beside bisection, both with the same kernel, on waves at three forces."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from rigctl.encoding.force import ForceMatrix, Method, Status, Trials, force_matrix
from rigctl.encoding.normalisation import Normalisation
from tests.bench._peers import row

TEXTURES, SPEEDS_MM_S, FORCES_G = ("A", "B"), (80.0, 120.0), (250.0, 500.0, 1000.0)
N_TRIALS, TRAVEL_MM, N_TAXELS = 100, 240.0, 18
RANGES = Normalisation.full_scale(N_TAXELS)
SCENE = "2 textures x 2 speeds x 2 forces x 18 taxels, 100 trials each, tolerance 0.1 Hz, one thread"


def measure() -> Iterator[dict[str, Any]]:
    """Time of both searches, and what they found."""
    trials = {
        (t, v, f): recorded(i, v, f)
        for i, t in enumerate(TEXTURES)
        for v in SPEEDS_MM_S
        for f in FORCES_G
    }
    searched(trials, Method.REGULA_FALSI)  # compiles
    ours, ours_s = searched(trials, Method.REGULA_FALSI)
    theirs, theirs_s = searched(trials, Method.BISECTION)
    note = (
        f"{SCENE}; encodings an entry {evaluations(ours):.2f} and {evaluations(theirs):.2f}, "
        f"not converged {ours.unconverged} and {theirs.unconverged}"
    )
    yield row("force_search.vs_bisection", ours_s, "s", "bisection of [0, 5]", theirs_s, note)


def recorded(texture: int, speed_mm_s: float, force_g: float) -> list[Any]:
    """Trials uint16 (n, 18): a steady level that saturates with force, and a wave on it."""
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


def searched(trials: dict[Any, Trials], method: Method) -> tuple[ForceMatrix, float]:
    """C of every condition, and how long it took, s."""
    start = time.perf_counter()
    found = force_matrix(
        lambda *key: trials[key], TEXTURES, SPEEDS_MM_S, FORCES_G, RANGES, method=method
    )
    return found, time.perf_counter() - start


def evaluations(found: ForceMatrix) -> float:
    """Mean encodings an entry that was searched."""
    return float(found.evaluations[found.status != Status.REFERENCE].mean())
