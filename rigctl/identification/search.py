"""A blind search: sets of parameters are drawn around the best, and where a line through all that
was found so far points to; the nearest to what is known is the best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.identification.measures import measure
from rigctl.identification.original_column import PAPER, accuracies
from rigctl.identification.sliding import slide
from rigctl.simulation.bench.parameters import (
    IDENTIFIED,
    ParameterInfo,
    WorldParameters,
    checked,
    table,
)

SEEDS = (1, 2, 3)
"""Sessions that each set of parameters is judged by: seats alone move a figure by ten points."""

REPEATS = 4
CHANGED = 0.4
"""Share of the unknowns that a step changes."""

START = {
    "frame_share": 0.5,
    "pressure_power": 2.1,
    "base_height_mm": 1.5,
    "base_space_mm": 8.0,
    "ridge_share": 0.55,
    "edge_drop_mm": 0.12,
    "bridging_mm": 0.25,
    "top_blur_mm": 1.1,
    "bottom_blur_mm": 1.8,
    "top_gain": 0.051,
    "bottom_gain": 0.07,
    "conductance_power": 1.3,
    "saturation_g": 2900.0,
    "gain_spread": 0.14,
    "plate_tilt_mm": 0.002,
    "mounting_spread": 0.017,
    "contact_shift_mm": 0.087,
    "contact_spread": 0.025,
    "viscous_lag_ms": 2.9,
    "relaxation": 0.1,
}
"""Where a search begins: where earlier ones, and single changes by hand, had come to from what a
smaller model needed. They too knew of no other column."""

SETS_GIVE_MORE = {
    "textures": 4.8,
    "groups": 4.4,
    "untrained-both": 8.4,
    "untrained-force": -0.4,
    "untrained-speed": 12.9,
    "trained-both": 3.4,
}
"""What virtual sets of seeds 1 and 2 with 100 repeats gave with START beyond slides of the same
seeds, points: more is learnt from more repeats. A candidate's figures are slides' and this."""

SPREAD = 0.25
"""Relative size of a change that is drawn."""

DRAWN_FIRST = 24
"""So many sets are drawn before the first one is foretold; then every other one is."""

SLOPE_POINTS, NOISE_POINTS, LONGEST = 20.0, 2.0, 0.5
"""Of a figure over the logarithm of a parameter, as expected; of a figure; of a foretold change."""

EXCESS_POINTS = 20.0
"""What a figure of the skin's at twice the bound of its range weighs."""


_Floats = NDArray[np.float64]


LEAST = 1e-6
"""Stands for a parameter that is 0, and stays so."""


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


class ParameterSearch:
    """Goes on from the best so far; the same for a seed."""

    def __init__(self, start: Candidate, seed: int) -> None:
        self.best = start
        self._tried = [start]
        self._random = np.random.default_rng(seed)

    def step(self) -> Candidate:
        """Try one more set of parameters; returns it."""
        foretold = len(self._tried) > DRAWN_FIRST and len(self._tried) % 2
        change = self._foretold() if foretold else self._drawn()
        tried = candidate(_changed(self.best.parameters, change))
        self._tried.append(tried)
        self.best = min(self.best, tried, key=lambda one: one.error)
        return tried

    def _drawn(self) -> _Floats:
        size = len(unknowns(self.best.parameters))
        chosen = self._random.random(size) < CHANGED
        drawn: _Floats = SPREAD * self._random.standard_normal(size) * chosen
        return drawn

    def _foretold(self) -> _Floats:
        """Change of the logarithms that a linear model of all that was tried calls best."""
        steps = np.array([_logarithms(one) for one in self._tried]) - _logarithms(self.best)
        rises = np.array([_figures(one) for one in self._tried]) - _figures(self.best)
        noise = NOISE_POINTS**2
        inner = steps.T @ steps + noise / SLOPE_POINTS**2 * np.eye(steps.shape[1])
        slopes = np.linalg.solve(inner, steps.T @ rises)
        missing = np.array([*PAPER.values(), 0.0]) - _figures(self.best)
        curve = slopes @ slopes.T + noise / SPREAD**2 * np.eye(len(slopes))
        change: _Floats = np.clip(np.linalg.solve(curve, slopes @ missing), -LONGEST, LONGEST)
        return change


def _logarithms(one: Candidate) -> _Floats:
    return np.log([max(row.value, LEAST) for row in unknowns(one.parameters)])


def _figures(one: Candidate) -> _Floats:
    return np.array([*(one.original[key] for key in PAPER), EXCESS_POINTS * one.excess])


def _changed(parameters: WorldParameters, change: _Floats) -> WorldParameters:
    """The unknowns times the exponentials of a change, within their ranges."""
    values: dict[str, Any] = {
        row.name: min(max(row.value * math.exp(by), row.low), row.high)
        for row, by in zip(unknowns(parameters), change, strict=True)
    }
    return replace(parameters, **values)


def unknowns(parameters: WorldParameters) -> list[ParameterInfo]:
    """The parameters that nothing but the Original column tells."""
    return [row for row in table(parameters) if row.source == IDENTIFIED]


def candidate(parameters: WorldParameters) -> Candidate:
    """Slide and judge. Raises WrongUse for a parameter out of its range."""
    sessions = slide(checked(parameters), REPEATS, SEEDS)
    found = [accuracies(session, seed) for seed, session in zip(SEEDS, sessions, strict=True)]
    excess = [measure(session).excess for session in sessions]
    means = {
        key: float(np.mean([one[key] for one in found])) + SETS_GIVE_MORE[key] for key in PAPER
    }
    return Candidate(parameters, means, float(np.mean(excess)))
