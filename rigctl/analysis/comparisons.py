"""Comparisons of representations: with Original, by components needed, with the paper's Table 1."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.representations import REPRESENTATIONS
from rigctl.analysis.statistics import Difference, welch_each
from rigctl.analysis.tasks import Curve, TaskResult

THRESHOLDS = (0.80, 0.90, 0.95)
CEILING = 0.99
TRAINING_TRIALS = {"folds": 6000, "extrapolation": 7200}
SMALL_TRAINING_SHARE = 0.5
NAME_OF = {representation.key: representation.name for representation in REPRESENTATIONS}


class Agreement(StrEnum):
    """Whether our results confirm a difference of the paper."""

    HOLDS = "holds"
    TIED = "cannot be told apart"
    REVERSED = "does not hold"


class RepresentationPair(NamedTuple):
    """Two representations with different accuracies in the paper; ``better``: by the paper.

    ``gap``: our accuracy, better less worse; ``spread``: two standard deviations of the pair (or as
    many as an analysis file says), None for a single draw; ``paper_gap``: the paper's.
    ``holds_at``: numbers of components with which the comparison holds.
    """

    better: Curve
    worse: Curve
    agreement: Agreement
    gap: float
    spread: float | None
    paper_gap: float
    holds_at: tuple[int, ...]

    @property
    def keys(self) -> tuple[str, str]:
        """Keys of both representations."""
        return self.better.representation.key, self.worse.representation.key


@dataclass(frozen=True, slots=True)
class TaskComparison:
    """The pairs of Table 1 that the paper separates, in one task.

    ``caveats``: differences from the paper's experiment, empty where all pairs hold.
    """

    pairs: tuple[RepresentationPair, ...]
    caveats: tuple[str, ...]

    def keys(self, agreement: Agreement) -> list[tuple[str, str]]:
        """Return the pairs with an agreement as (better, worse) by the paper."""
        return [pair.keys for pair in self.pairs if pair.agreement is agreement]

    @property
    def sentence(self) -> str:
        """How many pairs hold, and which do not."""
        if not self.pairs:
            return "The paper's own spreads separate no pair here."
        n_held = len(self.keys(Agreement.HOLDS))
        sentences = [f"{n_held} of the {len(self.pairs)} differences that the paper separates hold"]
        for agreement, title in (
            (Agreement.TIED, "Within the spread"),
            (Agreement.REVERSED, "Reversed"),
        ):
            listed = "; ".join(f"{NAME_OF[a]} over {NAME_OF[b]}" for a, b in self.keys(agreement))
            if listed:
                sentences.append(f"{title}: {listed}")
        return ". ".join(sentences) + "."


def components_needed(result: TaskResult) -> dict[str, dict[str, int | None]]:
    """Return the fewest components that reach a mean accuracy, by representation key and accuracy.

    The accuracies are 80, 90 and 95 % and ``as_original``, that of Original with the shown
    components. None where no number of components reaches it.
    """
    goals = {f"{share:.0%}": share for share in THRESHOLDS}
    original = result.curve("original")
    # No accuracy reaches infinity.
    goals["as_original"] = original.mean[result.shown_components - 1] if original else np.inf
    return {
        curve.representation.key: {
            name: _first_reaching(curve.mean, goal) for name, goal in goals.items()
        }
        for curve in result.curves
    }


def curve_differences(result: TaskResult) -> dict[str, tuple[Difference, ...]]:
    """Return Welch's test of each representation against Original for each number of components.

    By representation key, k_max differences each; empty where there is no Original.
    """
    original = result.curve("original")
    if original is None:
        return {}
    rule = result.thresholds.asterisks
    return {
        curve.representation.key: welch_each(curve.accuracy, original.accuracy, rule)
        for curve in result.curves
        if curve is not original
    }


def compare_task(result: TaskResult, *, simulated: bool) -> TaskComparison | None:
    """Compare a task with Table 1; None for a task that Table 1 does not have."""
    table = published.TABLE_1.get(result.task.key)
    if table is None:
        return None
    pairs = tuple(_separated_pairs(result, table))
    if all(pair.agreement is Agreement.HOLDS for pair in pairs):
        return TaskComparison(pairs, ())
    k = result.shown_components - 1
    near_ceiling = any(
        pair.agreement is Agreement.TIED and bool(pair.better.mean[k] > CEILING) for pair in pairs
    )
    return TaskComparison(pairs, _caveats(result, near_ceiling, simulated))


def _separated_pairs(
    result: TaskResult, table: dict[str, tuple[float, float]]
) -> Iterator[RepresentationPair]:
    """Yield the pairs of our curves that the paper's spreads separate, its better one first."""
    for first, second in combinations(table, 2):
        (mean_a, sd_a), (mean_b, sd_b) = table[first], table[second]
        one, other = result.curve(first), result.curve(second)
        if one is None or other is None:
            continue
        if abs(mean_a - mean_b) > result.thresholds.separation_sds * hypot(sd_a, sd_b):
            both = (one, other) if mean_a > mean_b else (other, one)
            yield _compare_pair(*both, result, abs(mean_a - mean_b) / 100)


def _compare_pair(
    better: Curve, worse: Curve, result: TaskResult, paper_gap: float
) -> RepresentationPair:
    gaps, shown = better.mean - worse.mean, result.shown_components
    gap = float(gaps[shown - 1])
    if better.sd is None or worse.sd is None:
        return RepresentationPair(better, worse, Agreement.TIED, gap, None, paper_gap, ())
    spreads = result.thresholds.separation_sds * np.hypot(better.sd, worse.sd)
    spread = float(spreads[shown - 1])
    agreement = Agreement.HOLDS if gap > 0 else Agreement.REVERSED
    if abs(gap) <= spread:
        agreement = Agreement.TIED
    holds_at = tuple(int(k) + 1 for k in np.flatnonzero(gaps > spreads))
    return RepresentationPair(better, worse, agreement, gap, spread, paper_gap, holds_at)


def _caveats(result: TaskResult, near_ceiling: bool, simulated: bool) -> tuple[str, ...]:
    caveats = []
    if near_ceiling:
        caveats.append("accuracies near 100 % leave no room for a difference")
    if result.shown_components < published.K_MAX:
        caveats.append(
            f"{result.shown_components} components were used instead of {published.K_MAX}"
        )
    if len(result.classes) != (4 if result.task.grouped else 16):
        caveats.append(f"the number of classes is {len(result.classes)}, not the paper's")
    if result.n_train < SMALL_TRAINING_SHARE * TRAINING_TRIALS[result.task.family]:
        caveats.append(
            f"the classifier is trained on {result.n_train:,} trials, the paper's on "
            f"{TRAINING_TRIALS[result.task.family]:,}"
        )
    if simulated:
        caveats.append(
            "the simulated sensor and plates are a model: heights, spacings and the sensor's "
            "nonlinearity are not published"
        )
    else:
        caveats.append("another sensor, other plates or another bench")
    return tuple(caveats)


def _first_reaching(mean: NDArray[np.float64], goal: float) -> int | None:
    reached = np.flatnonzero(mean >= goal)
    return int(reached[0]) + 1 if len(reached) else None
