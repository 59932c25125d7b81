"""Search for the unknown parameters of the simulated bench.

The paper's Original column and the statistics of real skins decide. ``make identify`` runs it for
half an hour and prints the parameters as a TOML file (decision 49).
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
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
from rigctl.bench.world_file import NOMINAL_WORLD, load_world
from rigctl.encoder.force_search import mean_sa_rates_hz
from rigctl.encoder.normalisation import Normalisation
from rigctl.errors import RigctlError
from tools.skin_figures import SkinFigures, measure_skin, skin_figures
from tools.slides import DEPTHS_MM, SlideSession, simulate_slides, slide_features

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


SEEDS = (11, 12, 13)
"""Sessions per candidate: alignments alone change an accuracy by ten points."""
JUDGES = (4, 5, 6)
"""Sessions that the search never sees."""

REPEATS, DEPTH_REPEATS = 4, 2
LEAST_REPEATS = 2
"""With one, no trial of a condition is left to test."""
CHANGED = 0.4
"""Share of the parameters that a random step changes."""

REPEATS_GAIN_POINTS = {
    "textures": 3.9,
    "groups": 1.9,
    "untrained-both": -1.2,
    "untrained-force": -0.7,
    "untrained-speed": 0.3,
    "trained-both": 0.7,
}
"""Percentage points that are added to a candidate's accuracies, because classifiers learn more from
more repeats: with nominal values and seed 11, slides of 16 repeats were better than of 4 by it.
Another skin may gain or lose ten points (decision 49): judge a result with ``--repeats 24``, where
nothing is added."""

SPREAD = 0.25
"""Relative size of a random change."""

RANDOM_STEPS = 24
"""Number of random steps before the first predicted one; after that, every other is predicted."""

SLOPE_POINTS, NOISE_POINTS, MAX_CHANGE = 20.0, 2.0, 0.2
"""Expected slope of an accuracy over a parameter's logarithm; noise of an accuracy; largest
predicted change of a logarithm."""

FIGURES = dict.fromkeys(PAPER, NOISE_POINTS) | {
    "between textures": 0.005,
    "over within": 0.05,
    "growth of the mean": 0.05,
    "growth of the amplitude": 0.05,
}
"""Figures that identify, the last four at set depths, with their noise from session to session."""

FREE = 0.7
"""A parameter is free if the figures narrow its logarithm to no less than this share of
:data:`PRIOR`, the spread that it has without them."""
PRIOR = 0.5

EXCESS_POINTS = 20.0
"""Penalty for a skin figure at twice the bound of its range."""

MIN_VALUE = 1e-6
"""Replaces a parameter of 0, which remains 0."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A set of parameters, its accuracies of the Original column, and the skin's excess.

    ``repeats``: trials of each condition. ``errors``: standard errors of the accuracies, which are
    means over the sessions of ``seeds``; NaN for a single one. ``depth``: the skin's figures at set
    depths. ``quiet``: share of SA trains, one of each taxel in each condition, that have less than
    :data:`rigctl.analysis.published.UNCONVERGED_RATE_HZ`.
    """

    parameters: WorldParameters
    repeats: int
    seeds: Sequence[int]
    original: dict[str, float]
    errors: dict[str, float]
    excess: float
    depth: SkinFigures
    quiet: float

    @property
    def error(self) -> float:
        """Rms deviation of the six accuracies from the paper's, points, plus the skin's penalty."""
        squares = [(self.original[key] - published) ** 2 for key, published in PAPER.items()]
        return math.sqrt(sum(squares) / len(squares)) + EXCESS_POINTS * self.excess

    def lines(self) -> list[str]:
        """Format the six accuracies beside the paper's, and the figures at set depths."""
        accuracies = [
            f"{key}: {self.original[key]:.1f} ± {self.errors[key]:.1f} (paper {PAPER[key]:.1f})"
            for key in PAPER
        ]
        unconverged, entries = published.UNCONVERGED_C
        return [
            *accuracies,
            f"at set depths: {', '.join(self.depth.cells)}",
            f"SA trains below {published.UNCONVERGED_RATE_HZ:g} Hz: {self.quiet:.1%} "
            f"(paper, without C: {unconverged / entries:.1%})",
        ]

    @property
    def figures(self) -> Floats:
        """The figures of :data:`FIGURES` over their noise, float64 (10,)."""
        levels = self.depth.levels
        ratios = np.mean([(level.textures, level.over_within) for level in levels], axis=0)
        growths = self.depth.mean_growth, self.depth.amplitude_growth
        values = *(self.original[key] for key in PAPER), *ratios, *growths
        return np.array(values) / list(FIGURES.values())

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
        parameters = _changed(self.best.parameters, change)
        candidate = evaluate(parameters, self.best.repeats, self.best.seeds)
        self.add(candidate)
        return candidate

    def add(self, candidate: Candidate) -> None:
        """Take an evaluated candidate, which is the best one from now on if it is."""
        self._candidates.append(candidate)
        self.best = min(self.best, candidate, key=lambda one: one.error)

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

    def precision(self) -> str:
        """Return a table: what identifies each parameter, and how well, by a linear model.

        The slopes are those of all candidates; the figures count as independent, with the noise of
        :data:`FIGURES`, so the spread is that of a likelihood that is Gaussian near the best.
        """
        steps = np.array([_logarithms(one) for one in self._candidates]) - _logarithms(self.best)
        rises = np.array([one.figures for one in self._candidates]) - self.best.figures
        prior = np.eye(steps.shape[1])
        slopes = np.linalg.solve(
            steps.T @ steps + prior / (SLOPE_POINTS / NOISE_POINTS) ** 2, steps.T @ rises
        )
        spread = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T + prior / PRIOR**2)))
        lines = ["| parameter | value | spread | most moved by it |\n", "| --- " * 4 + "|\n"]
        for row, narrowed, moved in zip(
            identified_parameters(self.best.parameters), spread, slopes, strict=True
        ):
            most = list(FIGURES)[int(np.argmax(np.abs(moved)))]
            cells = (f"± {narrowed:.0%}", most) if narrowed < FREE * PRIOR else ("free", "–")
            lines.append(f"| `{row.name}` | {row.value:.4g} {row.unit} | {' | '.join(cells)} |\n")
        return "".join(lines)


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
    """Return the parameters that are identified."""
    return [row for row in parameter_infos(parameters) if row.source == IDENTIFIED]


def evaluate(parameters: WorldParameters, repeats: int, seeds: Sequence[int] = SEEDS) -> Candidate:
    """Simulate and rate a set of parameters. Raises WrongUse for one outside its range."""
    found, excess, quiet = [], [], []
    for seed in seeds:
        (session,) = simulate_slides(validated(parameters), repeats, [seed])
        found.append(list(accuracies(session, seed).values()))
        excess.append(measure_skin(session).excess)
        quiet.append(quiet_share(session))
    (deep,) = simulate_slides(parameters, DEPTH_REPEATS, seeds[:1], DEPTHS_MM)
    depth = skin_figures(deep.samples, deep.design)
    gains = REPEATS_GAIN_POINTS if repeats == REPEATS else dict.fromkeys(PAPER, 0.0)
    means = np.mean(found, axis=0) + [gains[key] for key in PAPER]
    errors = dict.fromkeys(PAPER, math.nan)
    if len(seeds) > 1:
        spread = np.std(found, axis=0, ddof=1) / math.sqrt(len(seeds))
        errors = dict(zip(PAPER, spread.tolist(), strict=True))
    return Candidate(
        parameters,
        repeats,
        seeds,
        dict(zip(PAPER, means.tolist(), strict=True)),
        errors,
        float(np.mean(excess)) + depth.depth_excess,
        depth,
        float(np.mean(quiet)),
    )


def quiet_share(slides: SlideSession) -> float:
    """Return the share of SA trains that hardly fire, by the first trial of each condition."""
    ranges = Normalisation.from_samples(slides.samples, "all trials")
    rates_hz = [
        mean_sa_rates_hz([slides.samples[rows[0]]], ranges) for rows in slides.design.conditions()
    ]
    return float(np.mean(np.array(rates_hz) < published.UNCONVERGED_RATE_HZ))


SHOWN_REPEATS = 8


def main(arguments: list[str] | None = None) -> int:
    """Search, or with ``--steps 0`` only evaluate a world."""
    options = _parser().parse_args(arguments)
    try:
        world = NOMINAL_WORLD if options.world is None else load_world(options.world)
        start = replace(world.parameters, **dict(options.set))
        search = _search(evaluate(start, options.repeats, options.seeds), options)
    except RigctlError as error:
        print(f"rigctl: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    best = search.best
    print(best.toml())
    print("\n".join(f"# {line}" for line in best.lines()))
    (session,) = simulate_slides(best.parameters, SHOWN_REPEATS, [options.seed])
    print("\n".join(f"# {line}" for line in measure_skin(session).lines()))
    if options.steps:
        print(search.precision(), end="")
    return 0


def _search(start: Candidate, options: argparse.Namespace) -> ParameterSearch:
    began_s, steps = time.monotonic(), options.steps
    search = ParameterSearch(start, options.seed)
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
    return search


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=65, help="sets of parameters to try (65)")
    parser.add_argument(
        "--world",
        type=Path,
        help="world file at which to begin (default: the nominal bench)",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the search (1)")
    parser.add_argument(
        "--repeats",
        type=partial(_whole, LEAST_REPEATS),
        default=REPEATS,
        help=f"trials of each condition that rate a set ({REPEATS})",
    )
    parser.add_argument(
        "--seeds",
        type=partial(_whole, 0),
        nargs="+",
        default=SEEDS,
        help=f"sessions that rate a set ({' '.join(map(str, SEEDS))})",
    )
    parser.add_argument(
        "--set",
        type=_assignment,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="begin at another value of a parameter",
    )
    return parser


def _whole(least: int, text: str) -> int:
    if not text.isdecimal() or int(text) < least:
        raise argparse.ArgumentTypeError(f"{text!r}: give a number from {least} on")
    return int(text)


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
