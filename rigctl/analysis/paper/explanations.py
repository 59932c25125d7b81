"""Sentences with measurements that may explain why a comparison of Table 1 does not hold."""

from __future__ import annotations

from collections.abc import Sequence

from rigctl.analysis.paper.ablations import Ablations, FeatureHalf
from rigctl.analysis.paper.comparisons import CEILING, Agreement, RepresentationPair
from rigctl.analysis.paper.tasks import TaskResult

NEAR_CHANCE = 1.5


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
    if pair.spread is None:
        return "a single draw has no spread to compare with"
    sds = result.thresholds.separation_sds
    number = "two" if sds == 2 else f"{sds:g}"
    gap = (
        f"ours differ by {_points(pair.gap)}, {number} standard deviations are "
        f"{_points(pair.spread)}"
    )
    if not pair.holds_at:
        return f"{gap}; it holds with no number of components up to {result.k_max}"
    return f"{gap}; it holds with {_format_ranges(pair.holds_at)} components"


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


def _format_ranges(numbers: Sequence[int]) -> str:
    """Format ascending numbers, for example as 3–7, 12."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{r[0]}–{r[-1]}" if len(r) > 1 else str(r[0]) for r in runs)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _points(share: float) -> str:
    return f"{100 * share:.1f} points"
