"""The paper's tests of difference and their asterisks, with a sentence for each weak assumption."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import asin, erfc, sqrt
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis import published
from rigctl.analysis.settings import AsteriskThresholds
from rigctl.analysis.tasks import Curve, TaskResult
from rigctl.errors import WrongUse

Values = NDArray[np.float64]
AsteriskRule = tuple[tuple[str, float, float], ...]
_PAPER = AsteriskThresholds()
ASTERISKS: AsteriskRule = _PAPER.asterisks
"""Figure 4's rule: p is below the first bound and the size of Cohen's d above the second."""
PROPORTION_ASTERISKS: AsteriskRule = _PAPER.proportion_asterisks
"""Figure S5's rule, with Cohen's h."""
REDRAWN = (
    "The values compared are accuracies of repeated draws from the same trials. They are not "
    "independent, so p is smaller and d is larger than for new recordings."
)
REPEATED = (
    "A trial counts once for every draw that tests it. The counts are not independent, so p is "
    "smaller than for new recordings."
)
PAIRED = (
    "Both proportions are of the same trials; the two-proportion test takes them as independent."
)
CEILING_SHARE = 0.99
SIGNIFICANT_DIGITS = 6
NOT_IN_PAPER = (
    "The paper tests differences in Figures 4 and S5 only: those of Figure 3 are our addition."
)


class DifferenceTest(NamedTuple):
    """A test of difference: its name, and the name and letter of its effect size."""

    name: str
    effect_name: str
    effect_letter: str


WELCH = DifferenceTest("Welch's t", "Cohen's d", "d")
"""Two-tailed, of means; the paper uses it in Figure 4."""
TWO_PROPORTIONS = DifferenceTest("two-proportion z", "Cohen's h", "h")
"""Two-tailed, of shares; the paper uses it in Figure S5."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A test's statistic, its p and effect size, each None where it is not defined.

    ``assumptions``: sentences on assumptions that do not hold. ``rule``: of the asterisks.
    """

    statistic: float | None
    p: float | None
    effect: float | None
    assumptions: tuple[str, ...]
    rule: AsteriskRule = ASTERISKS
    test: DifferenceTest = WELCH

    @property
    def stars(self) -> str:
        """The asterisks of the rule; empty where the test is not defined."""
        if self.p is None or self.effect is None:
            return ""
        return asterisks(self.p, self.effect, self.rule)


def asterisks(p: float, effect: float, rule: AsteriskRule = ASTERISKS) -> str:
    """Return ``""``, ``"*"`` or ``"**"``; the sign of the effect does not matter."""
    earned = (stars for stars, most_p, least in rule if p < most_p and abs(effect) > least)
    return next(earned, "")


class _Moments(NamedTuple):
    """Mean and variance (divisor n − 1; 0 for a single value) of each column, and its length."""

    mean: Values
    variance: Values
    n: int

    @classmethod
    def of(cls, values: Values) -> _Moments:
        # Rows in memory have the same sums as columns that are given alone.
        rows, n = np.ascontiguousarray(values.T), len(values)
        variance = rows.var(axis=1, ddof=1) if n > 1 else np.zeros(len(rows))
        # Exactly 0 for equal values, whatever the rounding.
        variance[(rows == rows[:, :1]).all(axis=1)] = 0.0
        return cls(rows.mean(axis=1), variance, n)


def wilson_interval(correct: Any, n: int) -> tuple[Any, Any]:
    """Return the 95 % Wilson interval of ``correct`` out of ``n``, a number or an array each.

    It stays inside 0–1 for small n too (Wilson 1927, equation 4).
    """
    share, square = correct / n, NormalDist().inv_cdf(0.975) ** 2 / n
    middle = (share + square / 2) / (1 + square)
    half = np.sqrt(square * (share * (1 - share) + square / 4)) / (1 + square)
    return np.maximum(middle - half, 0.0), np.minimum(middle + half, 1.0)


def k_ranges(numbers: Sequence[int] | NDArray[np.intp]) -> str:
    """Return ascending whole numbers as ranges, such as ``5–30, 34``; ``none`` for no number."""
    runs: list[list[int]] = []
    for number in map(int, numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{r[0]}–{r[-1]}" if len(r) > 1 else f"{r[0]}" for r in runs) or "none"


def describe_rule(rule: AsteriskRule, test: DifferenceTest) -> str:
    """Return what the asterisks of a rule mean, fewer asterisks first."""
    return "; ".join(
        f"{stars} p < {most_p:g} and {test.effect_letter} > {least:g}"
        for stars, most_p, least in reversed(rule)
    )


def standard_deviation(values: Values) -> Values | None:
    """Return the standard deviation over rows (divisor n − 1): (n, k) to (k,); None for one row."""
    if len(values) < 2:
        return None
    return np.asarray(values.std(axis=0, ddof=1))


def standard_error(values: Values) -> Values | None:
    """Return the standard error of the mean over rows: (n, k) to (k,), None for a single row."""
    deviation = standard_deviation(values)
    return None if deviation is None else deviation / sqrt(len(values))


def welch_each(
    first: Values, second: Values, rule: AsteriskRule = ASTERISKS
) -> tuple[Difference, ...]:
    """Return the two-tailed Welch t-test and Cohen's d of accuracies (0–1) over draws of one set.

    One for each column: float64 (draws, k) both, such as k components. Raises :class:`WrongUse` for
    values that are not numbers.
    """
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise WrongUse("a test of difference has a value that is not a number: leave it out")
    one, other = _Moments.of(first), _Moments.of(second)
    varies = (one.variance > 0) | (other.variance > 0)
    defined = varies if min(one.n, other.n) > 1 else np.zeros_like(varies)
    both = [
        side._replace(mean=side.mean[defined], variance=side.variance[defined])
        for side in (one, other)
    ]
    tested, found = iter(_welch(*both)), []
    highest = np.maximum(one.mean, other.mean).tolist()
    for is_defined, most in zip(defined.tolist(), highest, strict=True):
        statistic, p, effect = next(tested) if is_defined else (None, None, None)
        weak = _weak_assumptions(most, min(one.n, other.n), is_defined)
        found.append(Difference(statistic, p, effect, weak, rule))
    return tuple(found)


def welch_of_moments(
    first: tuple[float, float], second: tuple[float, float], n: int, rule: AsteriskRule = ASTERISKS
) -> Difference:
    """Return the test of :func:`welch_each` from mean and standard deviation of ``n`` draws."""
    one, other = (_Moments(np.array([mean]), np.array([sd**2]), n) for mean, sd in (first, second))
    ((statistic, p, effect),) = _welch(one, other)
    return Difference(statistic, p, effect, (REDRAWN,), rule)


def _welch(one: _Moments, other: _Moments) -> list[tuple[float, float, float]]:
    """Return t, p and Cohen's d, the difference over the pooled deviation, of each column."""
    from scipy import stats

    if not len(one.mean):
        return []
    sides = [(side.mean, np.sqrt(side.variance), side.n) for side in (one, other)]
    found = stats.ttest_ind_from_stats(*sides[0], *sides[1], equal_var=False)
    squares = (one.n - 1) * one.variance + (other.n - 1) * other.variance
    effect = (one.mean - other.mean) / np.sqrt(squares / (one.n + other.n - 2))
    columns = (found.statistic, found.pvalue, effect)
    return list(zip(*(np.asarray(column).tolist() for column in columns), strict=True))


def _weak_assumptions(highest: float, fewest: int, is_defined: bool) -> tuple[str, ...]:
    weak = [REDRAWN]
    if highest > CEILING_SHARE:
        weak.append(
            "One side is close to 100 %, where accuracies cannot be normally distributed: "
            "p is a rough guide."
        )
    if fewest < 2:
        weak.append("One value on a side has no spread: Welch's test needs two or more.")
    elif not is_defined:
        weak.append("Neither side varies at all: Welch's t and Cohen's d are not defined.")
    return tuple(weak)


def two_proportions(
    first: int,
    second: int,
    n: int,
    n_second: int | None = None,
    *,
    rule: AsteriskRule = PROPORTION_ASTERISKS,
    weak: tuple[str, ...] = (PAIRED,),
) -> Difference:
    """Return the two-tailed two-proportion z-test and Cohen's h of two counts.

    ``n``: trials of both, or of the first where ``n_second`` is given; ``weak``: assumptions that
    do not hold. Positive where the first share is larger; z is None where no trial, or every one,
    is counted. Raises :class:`WrongUse` for counts that are not between 0 and their n.
    """
    others = n if n_second is None else n_second
    if not (n > 0 and others > 0 and 0 <= first <= n and 0 <= second <= others):
        trials = f"{n} trials" if others == n else f"{n} and {others} trials"
        raise WrongUse(f"{first} and {second} are no counts out of {trials}")
    effect = 2 * (asin(sqrt(first / n)) - asin(sqrt(second / others)))
    if first + second in (0, n + others):
        return Difference(None, None, effect, weak, rule, TWO_PROPORTIONS)
    pooled = (first + second) / (n + others)
    spread = sqrt(pooled * (1 - pooled) * (1 / n + 1 / others))
    z = (first / n - second / others) / spread
    return Difference(z, erfc(abs(z) / sqrt(2)), effect, weak, rule, TWO_PROPORTIONS)


def curve_test_dict(
    differences: Sequence[Difference], against: str, *, in_paper: bool
) -> dict[str, Any]:
    """Return the tests of one curve against another: lists with a value for each k from 1.

    ``in_paper``: whether the paper's figure has these asterisks. Undefined values are None.
    """
    first = differences[0]
    return {
        "against": against,
        "test": first.test.name,
        "effect_name": first.test.effect_name,
        "rule": describe_rule(first.rule, first.test),
        "in_paper": in_paper,
        "statistic": [_rounded(one.statistic) for one in differences],
        "p": [_rounded(one.p) for one in differences],
        "effect": [_rounded(one.effect) for one in differences],
        "stars": [one.stars for one in differences],
        "assumptions": sorted({text for one in differences for text in one.assumptions}),
    }


def difference_dict(found: Difference) -> dict[str, Any]:
    """Return one test as values for JSON."""
    return {
        "test": found.test.name,
        "statistic": found.statistic,
        "p": found.p,
        "effect": found.effect,
        "effect_name": found.test.effect_name,
        "rule": describe_rule(found.rule, found.test),
        "stars": found.stars,
        "assumptions": list(found.assumptions),
    }


def task_curve_tests(differences: Mapping[str, Sequence[Difference]]) -> dict[str, Any]:
    """Return the tests of a task of Figure 3 by representation key, each against Original."""
    return {
        key: curve_test_dict(each, "original", in_paper=False) for key, each in differences.items()
    }


def tests_rule(tests: Mapping[str, Mapping[str, Sequence[Difference]]]) -> str:
    """Return what the asterisks mean, empty where there is no test.

    ``tests``: differences by task and representation key.
    """
    each = (one for task in tests.values() for found in task.values() for one in found)
    first = next(each, None)
    return "" if first is None else describe_rule(first.rule, first.test)


def confusion_shares(result: TaskResult) -> dict[str, dict[str, Any]]:
    """Return the share of right answers in each confusion matrix, by representation key.

    ``paper``: the share in the caption of Figures S1 to S4 with ours tested against it, None for
    other tasks. ``from_original``: the test against the matrix of Original, None for Original.
    """
    original = result.curve("original")
    return {
        curve.representation.key: _share_dict(curve, original, result) for curve in result.curves
    }


def _share_dict(curve: Curve, original: Curve | None, result: TaskResult) -> dict[str, Any]:
    correct, n = _counts(curve)
    rule = result.thresholds.proportion_asterisks
    from_original = None
    if original is not None and original is not curve:
        theirs, n_theirs = _counts(original)
        weak = (REPEATED, PAIRED)
        found = two_proportions(correct, theirs, n, n_theirs, rule=rule, weak=weak)
        from_original = difference_dict(found)
    return {
        "correct": correct,
        "of": n,
        "percent": _percent(correct, n),
        "from_original": from_original,
        "paper": _paper_share(curve, result, rule),
    }


def _paper_share(curve: Curve, result: TaskResult, rule: AsteriskRule) -> dict[str, Any] | None:
    """Return the published share of a representation and our share tested against it."""
    key = curve.representation.key
    if result.task.key != published.CONFUSION_TASK or key not in published.CONFUSION_PERCENT:
        return None
    figure, percent = published.CONFUSION_PERCENT[key]
    n_paper = published.CONFUSION_TRIALS
    share = published_share(*_counts(curve), percent, n_paper, rule=rule, weak=(REPEATED,))
    return {"figure": figure, **share}


def published_share(
    correct: int,
    n: int,
    percent: float,
    n_paper: int,
    *,
    rule: AsteriskRule = PROPORTION_ASTERISKS,
    weak: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Return a published share in per cent and our ``correct`` of ``n`` tested against it.

    ``weak``: assumptions of the test that do not hold.
    """
    theirs = round(percent / 100 * n_paper)
    found = two_proportions(correct, theirs, n, n_paper, rule=rule, weak=weak)
    return {"percent": percent, "of": n_paper, "test": difference_dict(found)}


def _counts(curve: Curve) -> tuple[int, int]:
    return int(np.trace(curve.confusion)), int(curve.confusion.sum())


def _percent(correct: int, n: int) -> float:
    return float(f"{100 * correct / n:.{SIGNIFICANT_DIGITS}g}")


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")
