"""Comparisons of representations: with Original, by components needed, with the paper's Table 1.

Where a comparison of Table 1 does not hold, measurements may explain why: variance by factor, and
each half of the features alone. SA rates and RA counts are separate halves, as C acts on the SA
current only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.cache import Resources
from rigctl.analysis.representations import REPRESENTATIONS, RepresentationSet
from rigctl.analysis.splits import make_splits
from rigctl.analysis.statistics import Difference, k_ranges, welch_each, welch_of_moments
from rigctl.analysis.tasks import Curve, SweepSettings, TaskResult, score_splits
from rigctl.analysis.trial_set import Design

THRESHOLDS = (0.80, 0.90, 0.95)
CEILING = 0.99
TRAINING_TRIALS = {"folds": 6000, "extrapolation": 7200}
SMALL_TRAINING_SHARE = 0.5
DRAWS = 3
HALVES = ("SA", "RA")
ROWS_AT_ONCE = 512
Floats = NDArray[np.float64]
NEAR_CHANCE = 1.5


NAME_OF = {representation.key: representation.name for representation in REPRESENTATIONS}


class Agreement(StrEnum):
    """Whether our results confirm a difference of the paper."""

    HOLDS = "holds"
    TIED = "cannot be told apart"
    REVERSED = "does not hold"


class RepresentationPair(NamedTuple):
    """Two representations with different accuracies in the paper; ``better``: by the paper.

    ``gap``: our accuracy, better less worse; ``paper_gap``: the paper's. ``difference``: Welch's
    test of ours. ``holds_at``: numbers of components with which the comparison holds.
    """

    better: Curve
    worse: Curve
    agreement: Agreement
    gap: float
    difference: Difference
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
            return "The paper's own means and deviations separate no pair here."
        n_held = len(self.keys(Agreement.HOLDS))
        sentences = [f"{n_held} of the {len(self.pairs)} differences that the paper separates hold"]
        for agreement, title in (
            (Agreement.TIED, "Cannot be told apart"),
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
    """Yield the pairs of our curves whose means differ in the paper, its better one first.

    They differ if the test of our curves gives an asterisk for the paper's means and deviations.
    """
    n, rule = published.ITERATIONS, result.thresholds.asterisks
    for first, second in combinations(table, 2):
        mean_a, mean_b = table[first][0], table[second][0]
        one, other = result.curve(first), result.curve(second)
        if one is None or other is None:
            continue
        if welch_of_moments(table[first], table[second], n, rule).stars:
            both = (one, other) if mean_a > mean_b else (other, one)
            yield _compare_pair(*both, result, abs(mean_a - mean_b) / 100)


def _compare_pair(
    better: Curve, worse: Curve, result: TaskResult, paper_gap: float
) -> RepresentationPair:
    gaps, shown = better.mean - worse.mean, result.shown_components
    tests = welch_each(better.accuracy, worse.accuracy, result.thresholds.asterisks)
    starred = np.array([bool(test.stars) for test in tests])
    agreement = Agreement.TIED
    if starred[shown - 1]:
        agreement = Agreement.HOLDS if gaps[shown - 1] > 0 else Agreement.REVERSED
    holds_at = tuple((np.flatnonzero(starred & (gaps > 0)) + 1).tolist())
    gap = float(gaps[shown - 1])
    return RepresentationPair(better, worse, agreement, gap, tests[shown - 1], paper_gap, holds_at)


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


class FeatureHalf(NamedTuple):
    """SA rates or RA counts of one representation.

    ``texture``, ``speed``, ``force``: share of the variance between trials, summed over features,
    that the levels of one factor explain alone; ``within``: share inside conditions.
    ``first_window``: share of what speed explains that lies in the first window.
    ``mean_by_force``: mean over trials and features at each force level, ascending.
    """

    variance: float
    texture: float
    speed: float
    force: float
    within: float
    first_window: float
    mean_by_force: tuple[float, ...]


class Ablations(NamedTuple):
    """``halves``: by representation key, then SA and RA.

    ``alone``: accuracy from one half alone, by task, representation and half, with as many
    components as the task shows; mean of the first ``draws`` draws.
    """

    forces_g: tuple[float, ...]
    halves: dict[str, dict[str, FeatureHalf]]
    alone: dict[str, dict[str, dict[str, float]]]
    draws: int


class _VarianceJob(NamedTuple):
    features: Path
    design: Design
    n_windows: int


class _HalfJob(NamedTuple):
    key: str
    features: Path
    design: Design
    half: int
    family: str
    tasks: tuple[published.Task, ...]
    k: int
    seed: int
    draw: int


def measure_ablations(
    representations: RepresentationSet,
    results: Sequence[TaskResult],
    settings: SweepSettings,
    resources: Resources,
) -> Ablations | None:
    """Measure the ablations for the tasks of Table 1; None where none of them was run.

    The draws are the first ones of the results.
    """
    results = [result for result in results if result.task.key in published.TABLE_1]
    if not results:
        return None
    design = Design.from_trials(representations.trials, representations.settings)
    jobs = [
        _VarianceJob(representations.files[r.key], design, representations.layout(r).n_windows)
        for r in representations.present
    ]
    computed = resources.map(_split_variance, jobs, "splitting the variance of the features")
    halves = {r.key: both for r, both in zip(representations.present, computed, strict=True)}
    draws = min(DRAWS, settings.iterations)
    alone = _accuracies_alone(representations, design, results, settings.seed, draws, resources)
    return Ablations(representations.trials.forces_g, halves, alone, draws)


def _split_variance(job: _VarianceJob) -> dict[str, FeatureHalf]:
    """Return both halves of one representation's features, read a few rows at a time."""
    features: Floats = np.load(job.features, mmap_mode="r")
    conditions = job.design.conditions()
    which = np.empty(len(features), np.intp)
    for number, rows in enumerate(conditions):
        which[rows] = number
    sums = np.zeros((len(conditions), features.shape[1]))
    squares = np.zeros(features.shape[1])
    offset = features[0].copy()  # keeps the difference of large sums exact enough
    for at in range(0, len(features), ROWS_AT_ONCE):
        rows = features[at : at + ROWS_AT_ONCE] - offset
        np.add.at(sums, which[at : at + ROWS_AT_ONCE], rows)
        squares += (rows**2).sum(axis=0)
    first = np.array([rows[0] for rows in conditions])
    counts = np.array([len(rows) for rows in conditions], np.float64)
    width = features.shape[1] // 2
    return {
        name: _feature_half(
            sums[:, at : at + width],
            squares[at : at + width],
            counts,
            [levels[first] for levels in _factors(job.design)],
            job.n_windows,
            offset[at : at + width],
        )
        for name, at in zip(HALVES, (0, width), strict=True)
    }


def _factors(design: Design) -> tuple[NDArray[np.generic], ...]:
    return design.texture, design.speed_mm_s, design.force_g


def _feature_half(
    sums: Floats,
    squares: Floats,
    counts: Floats,
    factors: Sequence[NDArray[np.generic]],
    n_windows: int,
    offset: Floats,
) -> FeatureHalf:
    """Return a half from condition sums (conditions, features), squares and factor levels."""
    n = counts.sum()
    about_mean = sums.sum(axis=0) ** 2 / n
    variation = float((squares - about_mean).sum())
    tiny = float(np.finfo(float).tiny)
    total = max(variation, tiny)

    def between(levels: NDArray[np.generic]) -> Floats:
        explained: Floats = -about_mean
        for level in np.unique(levels):
            at = levels == level
            explained += sums[at].sum(axis=0) ** 2 / counts[at].sum()
        return explained

    texture, speed, force = (between(levels) for levels in factors)
    within = float((squares - (sums**2 / counts[:, None]).sum(axis=0)).sum())
    return FeatureHalf(
        max(variation, 0.0) / n,
        float(texture.sum()) / total,
        float(speed.sum()) / total,
        float(force.sum()) / total,
        max(0.0, within / total),
        float(speed[::n_windows].sum()) / max(float(speed.sum()), tiny),
        tuple(_means(sums, counts, factors[2], offset)),
    )


def _means(
    sums: Floats, counts: Floats, levels: NDArray[np.generic], offset: Floats
) -> list[float]:
    return [
        float((sums[levels == level].sum(axis=0) / counts[levels == level].sum() + offset).mean())
        for level in np.unique(levels)
    ]


def _accuracies_alone(
    representations: RepresentationSet,
    design: Design,
    results: Sequence[TaskResult],
    seed: int,
    draws: int,
    resources: Resources,
) -> dict[str, dict[str, dict[str, float]]]:
    """Return the mean accuracies over draws by task, representation and half."""
    jobs = []
    for family in dict.fromkeys(result.task.family for result in results):
        of_family = [result for result in results if result.task.family == family]
        tasks, k = tuple(r.task for r in of_family), min(r.shown_components for r in of_family)
        jobs += [
            _HalfJob(
                r.key, representations.files[r.key], design, half, family, tasks, k, seed, draw
            )
            for r in representations.present
            for half in range(len(HALVES))
            for draw in range(draws)
        ]
    scores = resources.map(_score_half, jobs, "classifying by SA rates and RA counts alone")
    alone: dict[str, dict[str, dict[str, float]]] = {}
    for job in jobs[::draws]:
        of_draws = [next(scores) for _ in range(draws)]
        for task in job.tasks:
            mean = float(np.mean([shares[task.key] for shares in of_draws]))
            alone.setdefault(task.key, {}).setdefault(job.key, {})[HALVES[job.half]] = mean
    return alone


def _score_half(job: _HalfJob) -> dict[str, float]:
    """Return the accuracy in each task of a family, from one half of the features."""
    features = np.load(job.features, mmap_mode="r")
    width = features.shape[1] // 2
    half = features[:, job.half * width : (job.half + 1) * width]
    splits = make_splits(job.design, job.family, job.seed, job.draw)
    scores = score_splits(half, job.design, splits, job.tasks, min(job.k, width))
    return {key: float(score.correct[-1]) / score.n_tested for key, score in scores.items()}


def explain(
    pair: RepresentationPair, result: TaskResult, ablations: Ablations | None
) -> tuple[str, ...]:
    """Return sentences with measurements on a pair that does not hold, none for one that holds."""
    if pair.agreement is Agreement.HOLDS:
        return ()
    sentences = [_gap_sentence(pair, result), *_level_sentences(pair, result)]
    if ablations is not None:
        sentences += _half_sentences(pair, result, ablations)
        for factor in ("speed", "force"):
            sentences += _factor_sentences(pair, factor, ablations)
    better = pair.better.representation
    blind = result.curve(f"{better.key}_blind") if better.sees_labels else None
    if blind is not None:
        share = _percent(float(blind.mean[result.shown_components - 1]))
        sentences.append(f"with a texture-blind C {better.name} reaches {share}")
    return tuple(sentences)


def _gap_sentence(pair: RepresentationPair, result: TaskResult) -> str:
    if pair.better.sd is None or pair.worse.sd is None:
        return "a single draw has no spread to compare with"
    gap = f"ours differ by {_points(pair.gap)}"
    if pair.difference.p is not None:
        gap += f", Welch's p = {pair.difference.p:.2g}, Cohen's d = {pair.difference.effect:.2g}"
    if not pair.holds_at:
        return f"{gap}; it holds with no number of components up to {result.k_max}"
    return f"{gap}; it holds with {k_ranges(pair.holds_at)} components"


def _level_sentences(pair: RepresentationPair, result: TaskResult) -> list[str]:
    k = result.shown_components - 1
    better, worse = float(pair.better.mean[k]), float(pair.worse.mean[k])
    if min(better, worse) > CEILING:
        return [f"both are above {CEILING:.0%}, which leaves no room for a difference"]
    if max(better, worse) < NEAR_CHANCE * result.chance:
        return [f"both are near chance ({_percent(result.chance)}), where no class is recognised"]
    return []


def _half_sentences(
    pair: RepresentationPair, result: TaskResult, ablations: Ablations
) -> list[str]:
    """Return the accuracies of both representations from one half of the features alone."""
    alone = ablations.alone.get(result.task.key, {})
    better, worse = (alone.get(key) for key in pair.keys)
    if better is None or worse is None:
        return []
    names = [curve.representation.name for curve in (pair.better, pair.worse)]
    sentences = [
        f"from {what} alone {names[0]} reaches {_percent(better[half])}, {names[1]} "
        f"{_percent(worse[half])}"
        for half, what in (("SA", "SA rates"), ("RA", "RA counts"))
    ]
    return ["; ".join(sentences)]


def _factor_sentences(pair: RepresentationPair, factor: str, ablations: Ablations) -> list[str]:
    """Return what speed or force explains, where only one of the pair is scaled for it."""
    both = pair.better.representation, pair.worse.representation
    scaled = [r for r in both if (r.speed_scaled if factor == "speed" else r.force)]
    if len(scaled) != 1 or any(r.key not in ablations.halves for r in both):
        return []
    halves = [ablations.halves[r.key] for r in both]
    shares = " and ".join(
        f"{_percent(getattr(halves[0][half], factor))} of the variance of {what} in "
        f"{both[0].name}, {_percent(getattr(halves[1][half], factor))} in {both[1].name}"
        for half, what in (("SA", "SA rates"), ("RA", "RA counts"))
    )
    sentences = [f"{factor} explains {shares}"]
    of_scaled = ablations.halves[scaled[0].key]
    if factor == "force":
        sentences.append(_ra_sentence(of_scaled["RA"], ablations.forces_g))
    else:
        sentences.append(
            f"{_percent(of_scaled['SA'].first_window)} of what speed explains of SA rates in "
            f"{scaled[0].name} lies in the first window, where each neuron starts from rest"
        )
    return sentences


def _ra_sentence(half: FeatureHalf, forces_g: Sequence[float]) -> str:
    low, high = half.mean_by_force[0], half.mean_by_force[-1]
    ratio = f"{high / low:.2f} times" if low > 0 else "not to be compared with"
    return (
        "C acts on the SA current only: the mean RA count at "
        f"{forces_g[-1]:g} g is {ratio} that at {forces_g[0]:g} g"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _points(share: float) -> str:
    return f"{100 * share:.1f} points"
