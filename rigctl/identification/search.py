"""A blind search: a step is kept where it brings the world nearer to what is known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rigctl.identification.measures import measure
from rigctl.identification.original import PAPER, accuracies
from rigctl.identification.slides import slide
from rigctl.world.parameters import IDENTIFIED, ParameterInfo, WorldParameters, checked, table

SEEDS = (1, 2, 3)
"""Sessions that each set of parameters is judged by: seats alone move a figure by ten points."""

REPEATS = 4
CHANGED = 0.4
"""Share of the unknowns that a step changes."""

START = {
    "frame_share": 0.5,
    "pressure_power": 1.8,
    "base_height_mm": 1.5,
    "base_space_mm": 8.0,
    "ridge_share": 0.55,
    "edge_drop_mm": 0.18,
    "bridging_mm": 0.25,
    "top_blur_mm": 1.5,
    "bottom_blur_mm": 1.8,
    "top_gain": 0.051,
    "bottom_gain": 0.082,
    "conductance_power": 1.24,
    "saturation_g": 4150.0,
    "gain_spread": 0.14,
    "plate_tilt_mm": 0.0125,
    "mounting_spread": 0.002,
    "contact_shift_mm": 0.087,
    "contact_spread": 0.02,
    "viscous_lag_ms": 2.9,
    "relaxation": 0.1,
}
"""Where a search begins: where a first one had come from what a smaller model needed."""

FIRST_SPREAD, MORE, LESS = 0.25, 1.4, 0.95
"""Relative size of a change; it grows with each step that is kept and shrinks with others."""

EXCESS_POINTS = 20.0
"""What a figure of the skin's at twice the bound of its range weighs."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A set of parameters, its figures of the Original column, and how far off it is."""

    parameters: WorldParameters
    original: dict[str, float]
    excess: float

    @property
    def error(self) -> float:
        """Rms of the six figures' distance from the paper's, points, and what the skin adds."""
        squares = [(self.original[key] - wanted) ** 2 for key, wanted in PAPER.items()]
        return math.sqrt(sum(squares) / len(squares)) + EXCESS_POINTS * self.excess

    def lines(self) -> list[str]:
        """The six figures beside the paper's."""
        return [f"{key}: {self.original[key]:.1f} (paper {PAPER[key]:.1f})" for key in PAPER]

    def toml(self) -> str:
        """The identified parameters as lines of a world file."""
        return "\n".join(
            f"{row.name} = {row.value:.4g}" + (f"  # {row.unit}" if row.unit else "")
            for row in unknowns(self.parameters)
        )


class Search:
    """Goes on from the best so far; the same for a seed."""

    def __init__(self, start: Candidate, seed: int) -> None:
        self.best = start
        self._random = np.random.default_rng(seed)
        self._spread = FIRST_SPREAD

    def step(self) -> Candidate:
        """Try one more set of parameters; returns it."""
        tried = candidate(self._changed())
        if tried.error < self.best.error:
            self.best = tried
            self._spread *= MORE
        else:
            self._spread *= LESS
        return tried

    def _changed(self) -> WorldParameters:
        values: dict[str, Any] = {}
        for row in unknowns(self.best.parameters):
            if self._random.random() < CHANGED:
                factor = math.exp(self._spread * self._random.standard_normal())
                values[row.name] = min(max(row.value * factor, row.low), row.high)
        return replace(self.best.parameters, **values)


def unknowns(parameters: WorldParameters) -> list[ParameterInfo]:
    """The parameters that nothing but the Original column tells."""
    return [row for row in table(parameters) if row.source == IDENTIFIED]


def candidate(parameters: WorldParameters) -> Candidate:
    """Slide and judge. Raises WrongUse for a parameter out of its range."""
    sessions = slide(checked(parameters), REPEATS, SEEDS)
    found = [accuracies(session, seed) for seed, session in zip(SEEDS, sessions, strict=True)]
    excess = [measure(session).excess for session in sessions]
    means = {key: float(np.mean([one[key] for one in found])) for key in PAPER}
    return Candidate(parameters, means, float(np.mean(excess)))
