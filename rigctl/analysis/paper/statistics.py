"""The paper's tests of difference and its asterisks, with a sentence for each weak assumption."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse

Values = NDArray[np.float64]


class AsteriskRule(NamedTuple):
    """Bounds for one and two asterisks: p below the first, size of the effect above the second."""

    effect: str
    one: tuple[float, float]
    two: tuple[float, float]

    def stars(self, p: float, effect: float) -> str:
        """Return ``""``, ``"*"`` or ``"**"``; the sign of the effect does not matter."""
        for stars, (p_below, effect_above) in (("**", self.two), ("*", self.one)):
            if p < p_below and abs(effect) > effect_above:
                return stars
        return ""


FIGURE_4 = AsteriskRule("Cohen's d", (0.05, 0.5), (0.01, 1.0))
FIGURE_S5 = AsteriskRule("Cohen's h", (0.05, 0.2), (0.01, 0.5))

REDRAWN = (
    "The values compared are accuracies of repeated draws from the same trials. They are not "
    "independent, so p is smaller and d is larger than for new recordings."
)
CEILING_SHARE = 0.99
MIN_EXPECTED = 5.0


@dataclass(frozen=True, slots=True)
class Difference:
    """The result of a test. ``p`` and ``effect`` are None where the test is not defined.

    ``assumptions``: sentences on assumptions that do not hold.
    """

    test: str
    rule: AsteriskRule
    statistic: float | None
    p: float | None
    effect: float | None
    assumptions: tuple[str, ...]

    @property
    def stars(self) -> str:
        """The paper's asterisks, empty where the test is not defined."""
        if self.p is None or self.effect is None:
            return ""
        return self.rule.stars(self.p, self.effect)


def cohens_d(first: Values, second: Values) -> float | None:
    """Return the difference of means over the pooled standard deviation, None where that is 0."""
    n, m = len(first), len(second)
    if n + m < 3:
        return None
    squares = (n - 1) * _variance(first) + (m - 1) * _variance(second)
    pooled = sqrt(squares / (n + m - 2))
    return float(first.mean() - second.mean()) / pooled if pooled > 0 else None


def cohens_h(first: float, second: float) -> float:
    """Return the difference of two proportions on the arcsine scale (statsmodels)."""
    from statsmodels.stats.proportion import proportion_effectsize

    return float(proportion_effectsize(first, second))


def wilson_interval(correct: Any, n: int) -> tuple[Any, Any]:
    """Return the 95 % Wilson interval of ``correct`` out of ``n``, a number or an array each.

    It stays inside 0–1 for small n too (statsmodels).
    """
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(correct, n, method="wilson")
    return low, high


def welch(first: Values, second: Values, *, redrawn: bool = True) -> Difference:
    """Return the two-tailed Welch t-test of two samples of accuracies (0–1), by Figure 4's rule.

    ``redrawn``: the values come from repeated draws of one set of trials. Raises
    :class:`WrongUse` for values that are not numbers.
    """
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise WrongUse("a test of difference has a value that is not a number: leave it out")
    weak = [REDRAWN] if redrawn else []
    weak += _ceiling_sentences(first, second)
    if min(len(first), len(second)) < 2:
        weak.append("One value on a side has no spread: Welch's test needs two or more.")
        return Difference("Welch t", FIGURE_4, None, None, None, tuple(weak))
    if _variance(first) == 0 and _variance(second) == 0:
        weak.append("Neither side varies at all: Welch's t and Cohen's d are not defined.")
        return Difference("Welch t", FIGURE_4, None, None, None, tuple(weak))
    from scipy import stats

    sides = [(float(x.mean()), sqrt(_variance(x)), len(x)) for x in (first, second)]
    found = stats.ttest_ind_from_stats(*sides[0], *sides[1], equal_var=False)
    d = cohens_d(first, second)
    return Difference(
        "Welch t", FIGURE_4, float(found.statistic), float(found.pvalue), d, tuple(weak)
    )


def two_proportions(correct: tuple[int, int], n: tuple[int, int]) -> Difference:
    """Return the two-tailed z-test of two accuracies, by Figure S5's rule.

    Raises :class:`WrongUse` where a side has no trials, or more correct answers than trials.
    """
    if min(n) < 1 or any(not 0 <= c <= m for c, m in zip(correct, n, strict=True)):
        raise WrongUse(f"{correct} correct answers of {n} trials cannot be compared")
    effect = cohens_h(correct[0] / n[0], correct[1] / n[1])
    pooled = sum(correct) / sum(n)
    if pooled in (0.0, 1.0):
        equal = "All answers of both sides are alike: the z-test is not defined."
        return Difference("two-proportion z", FIGURE_S5, None, None, effect, (equal,))
    from statsmodels.stats.proportion import proportions_ztest

    z, p = proportions_ztest(correct, n)
    expected = min(min(pooled, 1 - pooled) * m for m in n)
    few = f"Fewer than {MIN_EXPECTED:g} answers of a kind are expected: z is a rough guide."
    weak_assumptions = (few,) if expected < MIN_EXPECTED else ()
    return Difference("two-proportion z", FIGURE_S5, float(z), float(p), effect, weak_assumptions)


def _variance(values: Values) -> float:
    """Return the variance with divisor n − 1, exactly 0 for equal values whatever the rounding."""
    if len(values) < 2 or bool(np.all(values == values[0])):
        return 0.0
    return float(values.var(ddof=1))


def _ceiling_sentences(first: Values, second: Values) -> list[str]:
    if max(first.mean(), second.mean()) <= CEILING_SHARE:
        return []
    return [
        "One side is close to 100 %, where accuracies cannot be normally distributed: "
        "p is a rough guide."
    ]
