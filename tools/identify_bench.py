"""Search for the unknown parameters of the simulated bench by the paper's Original column.

``make identify`` runs it for half an hour and prints the parameters as a TOML file (decision 18).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.pca_lda import Split
from rigctl.analysis.splits import make_splits, stratified_folds
from rigctl.analysis.tasks import score_splits
from rigctl.analysis.trial_set import Design
from rigctl.bench.parameter_fields import ParameterInfo
from rigctl.bench.parameters import (
    IDENTIFIED,
    WorldParameters,
    parameter_infos,
    validated,
)
from rigctl.errors import RigctlError
from tools.skin_figures import measure_skin
from tools.slides import SlideSession, simulate_slides, slide_features

Floats = NDArray[np.float64]

TASKS = tuple(task for task in published.TASKS if task.key in published.TABLE_1)
PAPER = {key: cells["original"][0] for key, cells in published.TABLE_1.items()}
"""Per cent with 50 components; the only published column that the search reads."""

DRAWS = 4


def accuracies(slides: SlideSession, seed: int) -> dict[str, float]:
    """Return the accuracy of each task with 50 components, per cent."""
    features, design = slide_features(slides), slides.design
    fits = [_folds(design, seed)]
    fits += [make_splits(design, "extrapolation", seed, draw) for draw in range(DRAWS)]
    correct, tested = (dict.fromkeys(PAPER, 0) for _ in range(2))
    for splits in fits:
        tasks = [task for task in TASKS if task.key in splits[0].tests]
        for key, score in score_splits(features, design, splits, tasks, published.K_MAX).items():
            correct[key] += int(score.correct[-1])
            tested[key] += score.n_tested
    return {key: 100.0 * (correct[key] / tested[key]) for key in PAPER}


def _folds(design: Design, seed: int) -> list[Split]:
    """Split all trials into four folds: a third of so few would be too little for training."""
    folds = stratified_folds(design.texture, published.N_FOLDS, seed)
    return [Split(train, {"textures": test, "groups": test}) for train, test in folds]


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

    def _random_change(self) -> Floats:
        size = len(identified_parameters(self.best.parameters))
        chosen = self._random.random(size) < CHANGED
        change: Floats = SPREAD * self._random.standard_normal(size) * chosen
        return change

    def _predicted_change(self) -> Floats:
        """Return the best change of the logarithms by a linear model of all candidates."""
        steps = np.array([_logarithms(one) for one in self._candidates]) - _logarithms(self.best)
        rises = np.array([_figures(one) for one in self._candidates]) - _figures(self.best)
        noise = NOISE_POINTS**2
        inner = steps.T @ steps + noise / SLOPE_POINTS**2 * np.eye(steps.shape[1])
        slopes = np.linalg.solve(inner, steps.T @ rises)
        missing = np.array([*PAPER.values(), 0.0]) - _figures(self.best)
        curve = slopes @ slopes.T + noise / SPREAD**2 * np.eye(len(slopes))
        change: Floats = np.clip(np.linalg.solve(curve, slopes @ missing), -MAX_CHANGE, MAX_CHANGE)
        return change


def _logarithms(one: Candidate) -> Floats:
    return np.log([max(row.value, MIN_VALUE) for row in identified_parameters(one.parameters)])


def _figures(one: Candidate) -> Floats:
    return np.array([*(one.original[key] for key in PAPER), EXCESS_POINTS * one.excess])


def _changed(parameters: WorldParameters, change: Floats) -> WorldParameters:
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


SHOWN_REPEATS = 8


def main(arguments: list[str] | None = None) -> int:
    """Search, or with ``--steps 0`` only evaluate the nominal world."""
    options = _parser().parse_args(arguments)
    try:
        values: dict[str, Any] = (START if options.steps else {}) | dict(options.set)
        best = _search(replace(WorldParameters(), **values), options.steps, options.seed)
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    print(best.toml())
    print("\n".join(f"# {line}" for line in best.lines()))
    (session,) = simulate_slides(best.parameters, SHOWN_REPEATS, [options.seed])
    print("\n".join(f"# {line}" for line in measure_skin(session).lines()))
    return 0


def _search(start: WorldParameters, steps: int, seed: int) -> Candidate:
    began_s = time.monotonic()
    search = ParameterSearch(evaluate(start), seed)
    for step in range(1, steps + 1):
        search.step()
        passed_s = time.monotonic() - began_s
        left_min = passed_s / step * (steps - step) / 60.0
        print(
            f"\r{step} of {steps} steps · best {search.best.error:.2f} points off · "
            f"{math.ceil(left_min)} min left ",
            end="",
            file=sys.stderr,
        )
    print(file=sys.stderr)
    return search.best


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=100, help="sets of parameters to try (100)")
    parser.add_argument("--seed", type=int, default=1, help="of the search (1)")
    parser.add_argument(
        "--set",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="begin at another value of a parameter",
    )
    return parser


def _assignment(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    if name not in {row.name for row in parameter_infos()}:
        raise argparse.ArgumentTypeError(f"no parameter {name!r}: docs/reference/world.md has them")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: write {name}=NUMBER") from None


if __name__ == "__main__":
    sys.exit(main())
