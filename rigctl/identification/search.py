"""Blind search for the bench's unknown parameters.

Candidates are drawn around the best one, or predicted by a linear model of all candidates; the one
nearest to the published accuracies is the best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.identification.measures import measure_skin
from rigctl.identification.original_column import PAPER, accuracies
from rigctl.identification.sliding import simulate_slides
from rigctl.simulation.bench.world.parameter_fields import ParameterInfo
from rigctl.simulation.bench.world.parameters import (
    IDENTIFIED,
    WorldParameters,
    parameter_infos,
    validated,
)

SEEDS = (1, 2, 3)
"""Sessions per candidate: alignments alone change an accuracy by ten points."""

REPEATS = 4
CHANGED = 0.4
"""Share of the parameters that a random step changes."""

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
"""Parameters at which a search begins: the result of earlier searches and single changes by hand,
which began with the values of a smaller model. They, too, used the Original column alone."""

REPEATS_GAIN_POINTS = {
    "textures": 4.8,
    "groups": 4.4,
    "untrained-both": 8.4,
    "untrained-force": -0.4,
    "untrained-speed": 12.9,
    "trained-both": 3.4,
}
"""Percentage points that are added to a candidate's accuracies, because classifiers learn more from
more repeats: with START and seeds 1 and 2, virtual data sets of 100 repeats were better than slides
by so much."""

SPREAD = 0.25
"""Relative size of a random change."""

RANDOM_STEPS = 24
"""Number of random steps before the first predicted one; after that, every other is predicted."""

SLOPE_POINTS, NOISE_POINTS, MAX_CHANGE = 20.0, 2.0, 0.5
"""Expected slope of an accuracy over a parameter's logarithm; noise of an accuracy; largest
predicted change of a logarithm."""

EXCESS_POINTS = 20.0
"""Penalty for a skin figure at twice the bound of its range."""

MIN_VALUE = 1e-6
"""Replaces a parameter of 0, which remains 0."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Candidate:
    """A set of parameters, its accuracies of the Original column, and the skin's excess."""

    parameters: WorldParameters
    original: dict[str, float]
    excess: float

    @property
    def error(self) -> float:
        """Rms deviation of the six accuracies from the paper's, points, plus the skin's penalty."""
        squares = [(self.original[key] - published) ** 2 for key, published in PAPER.items()]
        return math.sqrt(sum(squares) / len(squares)) + EXCESS_POINTS * self.excess

    def lines(self) -> list[str]:
        """Format the six accuracies beside the paper's."""
        return [f"{key}: {self.original[key]:.1f} (paper {PAPER[key]:.1f})" for key in PAPER]

    def toml(self) -> str:
        """Format the identified parameters as lines of a world file."""
        return "\n".join(
            f"{row.name} = {row.value:.4g}" + (f"  # {row.unit}" if row.unit else "")
            for row in identified_parameters(self.parameters)
        )


class ParameterSearch:
    """A search from a starting candidate, reproducible for a seed."""

    def __init__(self, start: Candidate, seed: int) -> None:
        self.best = start
        self._candidates = [start]
        self._random = np.random.default_rng(seed)

    def step(self) -> Candidate:
        """Evaluate and return one more candidate."""
        predict = len(self._candidates) > RANDOM_STEPS and len(self._candidates) % 2
        change = self._predicted_change() if predict else self._random_change()
        candidate = evaluate(_changed(self.best.parameters, change))
        self._candidates.append(candidate)
        self.best = min(self.best, candidate, key=lambda one: one.error)
        return candidate

    def _random_change(self) -> _Floats:
        size = len(identified_parameters(self.best.parameters))
        chosen = self._random.random(size) < CHANGED
        change: _Floats = SPREAD * self._random.standard_normal(size) * chosen
        return change

    def _predicted_change(self) -> _Floats:
        """Return the best change of the logarithms by a linear model of all candidates."""
        steps = np.array([_logarithms(one) for one in self._candidates]) - _logarithms(self.best)
        rises = np.array([_figures(one) for one in self._candidates]) - _figures(self.best)
        noise = NOISE_POINTS**2
        inner = steps.T @ steps + noise / SLOPE_POINTS**2 * np.eye(steps.shape[1])
        slopes = np.linalg.solve(inner, steps.T @ rises)
        missing = np.array([*PAPER.values(), 0.0]) - _figures(self.best)
        curve = slopes @ slopes.T + noise / SPREAD**2 * np.eye(len(slopes))
        change: _Floats = np.clip(np.linalg.solve(curve, slopes @ missing), -MAX_CHANGE, MAX_CHANGE)
        return change


def _logarithms(one: Candidate) -> _Floats:
    return np.log([max(row.value, MIN_VALUE) for row in identified_parameters(one.parameters)])


def _figures(one: Candidate) -> _Floats:
    return np.array([*(one.original[key] for key in PAPER), EXCESS_POINTS * one.excess])


def _changed(parameters: WorldParameters, change: _Floats) -> WorldParameters:
    """Scale the identified parameters by the exponentials of a change, within their ranges."""
    values: dict[str, Any] = {
        row.name: min(max(row.value * math.exp(by), row.low), row.high)
        for row, by in zip(identified_parameters(parameters), change, strict=True)
    }
    return replace(parameters, **values)


def identified_parameters(parameters: WorldParameters) -> list[ParameterInfo]:
    """Return the parameters that are identified from the Original column."""
    return [row for row in parameter_infos(parameters) if row.source == IDENTIFIED]


def evaluate(parameters: WorldParameters) -> Candidate:
    """Simulate and rate a set of parameters. Raises WrongUse for one outside its range."""
    sessions = simulate_slides(validated(parameters), REPEATS, SEEDS)
    found = [accuracies(session, seed) for seed, session in zip(SEEDS, sessions, strict=True)]
    excess = [measure_skin(session).excess for session in sessions]
    means = {
        key: float(np.mean([one[key] for one in found])) + REPEATS_GAIN_POINTS[key] for key in PAPER
    }
    return Candidate(parameters, means, float(np.mean(excess)))
