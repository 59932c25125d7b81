"""What the curves say: components needed, differences from Original, orders beside the paper's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from math import hypot

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import paper
from rigctl.analysis.representations import REPRESENTATIONS
from rigctl.analysis.statistics import Difference, welch
from rigctl.analysis.tasks import Curve, TaskResult

THRESHOLDS = (0.80, 0.90, 0.95)
SEPARATE = 2.0
CEILING = 0.99
LEARNT = {"folds": 6000, "extrapolation": 7200}
SMALL_SHARE = 0.5
NAME_OF = {representation.key: representation.name for representation in REPRESENTATIONS}


@dataclass(frozen=True, slots=True)
class Needed:
    """Fewest components for a mean accuracy; None where it is never reached.

    ``thresholds``: by share. ``as_original``: for Original's accuracy with the shown components.
    """

    thresholds: dict[float, int | None]
    as_original: int | None


@dataclass(frozen=True, slots=True)
class Order:
    """Table 1's order in one task: of the pairs that the paper separates, how ours fall.

    ``reversed_pairs``, ``ties``: (better, worse) by the paper. ``reasons``: why that may be.
    """

    pairs: int
    held: int
    ties: tuple[tuple[str, str], ...]
    reversed_pairs: tuple[tuple[str, str], ...]
    reasons: tuple[str, ...]

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


def components_needed(result: TaskResult) -> dict[str, Needed]:
    """For each representation, by key."""
    original = result.curve("original")
    goal = original.mean[result.shown - 1] if original else None
    return {
        curve.representation.key: Needed(
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


def order(result: TaskResult, *, simulated: bool) -> Order | None:
    """Ours beside Table 1's; None for a task that it does not have."""
    table = paper.TABLE_1.get(result.task.key)
    if table is None:
        return None
    ties: list[tuple[str, str]] = []
    reversed_pairs: list[tuple[str, str]] = []
    pairs, near_ceiling = 0, False
    for better, worse in _separated(result, table):
        pairs += 1
        keys = (better.representation.key, worse.representation.key)
        gap, spread = _gap(better, worse, result.shown)
        if abs(gap) <= spread:
            ties.append(keys)
            near_ceiling |= bool(better.mean[result.shown - 1] > CEILING)
        elif gap < 0:
            reversed_pairs.append(keys)
    held = pairs - len(ties) - len(reversed_pairs)
    reasons = _reasons(result, near_ceiling, simulated) if held < pairs else ()
    return Order(pairs, held, tuple(ties), tuple(reversed_pairs), reasons)


def _separated(
    result: TaskResult, table: dict[str, tuple[float, float]]
) -> Iterator[tuple[Curve, Curve]]:
    """Pairs of our curves, better first by the paper, where its spreads keep them apart."""
    for first, second in combinations(table, 2):
        (mean_a, sd_a), (mean_b, sd_b) = table[first], table[second]
        one, other = result.curve(first), result.curve(second)
        if one is None or other is None:
            continue
        if abs(mean_a - mean_b) > SEPARATE * hypot(sd_a, sd_b):
            yield (one, other) if mean_a > mean_b else (other, one)


def _gap(better: Curve, worse: Curve, shown: int) -> tuple[float, float]:
    """Difference of means, and the spread within which it says nothing."""
    k = shown - 1
    spread = [0.0 if c.deviation is None else float(c.deviation[k]) for c in (better, worse)]
    return float(better.mean[k] - worse.mean[k]), SEPARATE * hypot(*spread)


def _reasons(result: TaskResult, near_ceiling: bool, simulated: bool) -> tuple[str, ...]:
    said = []
    if near_ceiling:
        said.append("accuracies near 100 % leave no room for a difference")
    if result.shown < paper.K_MAX:
        said.append(
            f"{result.shown} components were possible instead of {paper.K_MAX}: the set is smaller"
        )
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
