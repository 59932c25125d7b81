"""What the curves say: components needed, differences from Original, orders beside the paper's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.features.representations import REPRESENTATIONS
from rigctl.analysis.paper import published
from rigctl.analysis.paper.statistics import Difference, welch
from rigctl.analysis.paper.tasks import Curve, TaskResult

THRESHOLDS = (0.80, 0.90, 0.95)
SEPARATE = 2.0
CEILING = 0.99
LEARNT = {"folds": 6000, "extrapolation": 7200}
SMALL_SHARE = 0.5
NAME_OF = {representation.key: representation.name for representation in REPRESENTATIONS}


@dataclass(frozen=True, slots=True)
class ComponentsNeeded:
    """Fewest components for a mean accuracy; None where it is never reached.

    ``thresholds``: by share. ``as_original``: for Original's accuracy with the shown components.
    """

    thresholds: dict[float, int | None]
    as_original: int | None


class Agreement(StrEnum):
    """How a difference of the paper stands in our results."""

    HOLDS = "holds"
    TIED = "cannot be told apart"
    REVERSED = "does not hold"


class RepresentationPair(NamedTuple):
    """Two representations that the paper keeps apart; ``better`` by the paper.

    ``gap``: ours, better less worse, as a share; ``spread``: two standard deviations of the pair,
    None for a single draw; ``paper_gap``: theirs. ``holds_at``: numbers of components at which the
    order holds.
    """

    better: Curve
    worse: Curve
    verdict: Agreement
    gap: float
    spread: float | None
    paper_gap: float
    holds_at: tuple[int, ...]

    @property
    def keys(self) -> tuple[str, str]:
        """Of both representations."""
        return self.better.representation.key, self.worse.representation.key


@dataclass(frozen=True, slots=True)
class TaskComparison:
    """Table 1's order in one task: of the pairs that the paper separates, how ours fall.

    ``reasons``: what makes this set another experiment, where not all hold.
    """

    compared: tuple[RepresentationPair, ...]
    reasons: tuple[str, ...]

    @property
    def pairs(self) -> int:
        """How many pairs the paper separates."""
        return len(self.compared)

    @property
    def held(self) -> int:
        """How many of them hold."""
        return len(self._with(Agreement.HOLDS))

    @property
    def ties(self) -> tuple[tuple[str, str], ...]:
        """Pairs that cannot be told apart, (better, worse) by the paper."""
        return self._with(Agreement.TIED)

    @property
    def reversed_pairs(self) -> tuple[tuple[str, str], ...]:
        """Pairs that fall the other way."""
        return self._with(Agreement.REVERSED)

    def _with(self, verdict: Agreement) -> tuple[tuple[str, str], ...]:
        return tuple(pair.keys for pair in self.compared if pair.verdict is verdict)

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if not self.pairs:
            return "The paper's own spreads separate no pair here."
        said = [f"{self.held} of the {self.pairs} differences that the paper separates hold"]
        for pairs, what in ((self.ties, "Within the spread"), (self.reversed_pairs, "Reversed")):
            if pairs:
                named = "; ".join(f"{NAME_OF[a]} over {NAME_OF[b]}" for a, b in pairs)
                said.append(f"{what}: {named}")
        return ". ".join(said) + "."


def components_needed(result: TaskResult) -> dict[str, ComponentsNeeded]:
    """For each representation, by key."""
    original = result.curve("original")
    goal = original.mean[result.shown - 1] if original else None
    return {
        curve.representation.key: ComponentsNeeded(
            {share: _first(curve.mean, share) for share in THRESHOLDS},
            None if goal is None else _first(curve.mean, float(goal)),
        )
        for curve in result.curves
    }


def differences(result: TaskResult) -> dict[str, Difference]:
    """Welch's test of each representation against Original with the shown components."""
    original = result.curve("original")
    if original is None:
        return {}
    k = result.shown - 1
    return {
        curve.representation.key: welch(curve.accuracy[:, k], original.accuracy[:, k])
        for curve in result.curves
        if curve is not original
    }


def compare_task(result: TaskResult, *, simulated: bool) -> TaskComparison | None:
    """Ours beside Table 1's; None for a task that it does not have."""
    table = published.TABLE_1.get(result.task.key)
    if table is None:
        return None
    compared = tuple(_pairs(result, table))
    k = result.shown - 1
    near_ceiling = any(
        pair.verdict is Agreement.TIED and bool(pair.better.mean[k] > CEILING) for pair in compared
    )
    held = all(pair.verdict is Agreement.HOLDS for pair in compared)
    return TaskComparison(compared, () if held else _reasons(result, near_ceiling, simulated))


def _pairs(
    result: TaskResult, table: dict[str, tuple[float, float]]
) -> Iterator[RepresentationPair]:
    """Pairs of our curves, better first by the paper, where its spreads keep them apart."""
    for first, second in combinations(table, 2):
        (mean_a, sd_a), (mean_b, sd_b) = table[first], table[second]
        one, other = result.curve(first), result.curve(second)
        if one is None or other is None:
            continue
        if abs(mean_a - mean_b) > SEPARATE * hypot(sd_a, sd_b):
            both = (one, other) if mean_a > mean_b else (other, one)
            yield _pair(*both, result.shown, abs(mean_a - mean_b) / 100)


def _pair(better: Curve, worse: Curve, shown: int, paper_gap: float) -> RepresentationPair:
    gaps = better.mean - worse.mean
    gap = float(gaps[shown - 1])
    if better.deviation is None or worse.deviation is None:
        return RepresentationPair(better, worse, Agreement.TIED, gap, None, paper_gap, ())
    spreads = SEPARATE * np.hypot(better.deviation, worse.deviation)
    spread = float(spreads[shown - 1])
    verdict = Agreement.HOLDS if gap > 0 else Agreement.REVERSED
    if abs(gap) <= spread:
        verdict = Agreement.TIED
    holds_at = tuple(int(k) + 1 for k in np.flatnonzero(gaps > spreads))
    return RepresentationPair(better, worse, verdict, gap, spread, paper_gap, holds_at)


def _reasons(result: TaskResult, near_ceiling: bool, simulated: bool) -> tuple[str, ...]:
    said = []
    if near_ceiling:
        said.append("accuracies near 100 % leave no room for a difference")
    if result.shown < published.K_MAX:
        said.append(f"{result.shown} components were used instead of {published.K_MAX}")
    if len(result.classes) != (4 if result.task.grouped else 16):
        said.append(f"{len(result.classes)} classes are told apart, not the paper's")
    if result.learnt < SMALL_SHARE * LEARNT[result.task.family]:
        said.append(
            f"the classifier learns from {result.learnt:,} trials, the paper's from "
            f"{LEARNT[result.task.family]:,}"
        )
    if simulated:
        said.append(
            "the simulated sensor and plates are a model: heights, spacings and the sensor's "
            "nonlinearity are not published"
        )
    else:
        said.append("another sensor, other plates or another bench")
    return tuple(said)


def _first(mean: NDArray[np.float64], goal: float) -> int | None:
    reached = np.flatnonzero(mean >= goal)
    return int(reached[0]) + 1 if len(reached) else None
