"""The paper's test of difference and its asterisks, with a sentence for each weak assumption."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse

Values = NDArray[np.float64]

AsteriskRule = tuple[tuple[str, float, float], ...]
ASTERISKS: AsteriskRule = (("**", 0.01, 1.0), ("*", 0.05, 0.5))
"""Figure 4's rule: p is below the first bound and the size of Cohen's d above the second."""
PROPORTION_ASTERISKS: AsteriskRule = (("**", 0.01, 0.5), ("*", 0.05, 0.2))
"""Figure S5's rule, with Cohen's h."""
REDRAWN = (
    "The values compared are accuracies of repeated draws from the same trials. They are not "
    "independent, so p is smaller and d is larger than for new recordings."
)
PAIRED = (
    "Both proportions are of the same trials; the two-proportion test takes them as independent."
)
CEILING_SHARE = 0.99


@dataclass(frozen=True, slots=True)
class Difference:
    """Welch's t, its p and Cohen's d, each None where it is not defined; or z, p and Cohen's h.

    ``assumptions``: sentences on assumptions that do not hold. ``rule``: of the asterisks.
    """

    statistic: float | None
    p: float | None
    effect: float | None
    assumptions: tuple[str, ...]
    rule: AsteriskRule = ASTERISKS

    @property
    def stars(self) -> str:
        """The paper's asterisks; empty where the test is not defined."""
        if self.p is None or self.effect is None:
            return ""
        return asterisks(self.p, self.effect, self.rule)


def asterisks(p: float, effect: float, rule: AsteriskRule = ASTERISKS) -> str:
    """Return ``""``, ``"*"`` or ``"**"``; the sign of the effect does not matter."""
    earned = (stars for stars, most_p, least in rule if p < most_p and abs(effect) > least)
    return next(earned, "")


def cohens_d(first: Values, second: Values) -> float | None:
    """Return the difference of means over the pooled standard deviation, None where that is 0."""
    n, m = len(first), len(second)
    if n + m < 3:
        return None
    squares = (n - 1) * _variance(first) + (m - 1) * _variance(second)
    pooled = sqrt(squares / (n + m - 2))
    return float(first.mean() - second.mean()) / pooled if pooled > 0 else None


def wilson_interval(correct: Any, n: int) -> tuple[Any, Any]:
    """Return the 95 % Wilson interval of ``correct`` out of ``n``, a number or an array each.

    It stays inside 0–1 for small n too (statsmodels).
    """
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(correct, n, method="wilson")
    return low, high


def welch(first: Values, second: Values) -> Difference:
    """Return the two-tailed Welch t-test of accuracies (0–1) over repeated draws of one set.

    Raises :class:`WrongUse` for values that are not numbers.
    """
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise WrongUse("a test of difference has a value that is not a number: leave it out")
    weak = [REDRAWN]
    if max(first.mean(), second.mean()) > CEILING_SHARE:
        weak.append(
            "One side is close to 100 %, where accuracies cannot be normally distributed: "
            "p is a rough guide."
        )
    if min(len(first), len(second)) < 2:
        weak.append("One value on a side has no spread: Welch's test needs two or more.")
        return Difference(None, None, None, tuple(weak))
    if _variance(first) == 0 and _variance(second) == 0:
        weak.append("Neither side varies at all: Welch's t and Cohen's d are not defined.")
        return Difference(None, None, None, tuple(weak))
    from scipy import stats

    sides = [(float(x.mean()), sqrt(_variance(x)), len(x)) for x in (first, second)]
    found = stats.ttest_ind_from_stats(*sides[0], *sides[1], equal_var=False)
    effect = cohens_d(first, second)
    return Difference(float(found.statistic), float(found.pvalue), effect, tuple(weak))


def two_proportions(first: int, second: int, n: int) -> Difference:
    """Return the two-tailed two-proportion z-test and Cohen's h of two counts out of ``n`` trials.

    Positive where the first is larger; z is None where no trial, or every one, is counted.
    Raises :class:`WrongUse` for counts that are not between 0 and n.
    """
    from statsmodels.stats.proportion import proportion_effectsize, proportions_ztest

    if not (n > 0 and 0 <= first <= n and 0 <= second <= n):
        raise WrongUse(f"{first} and {second} are no counts out of {n} trials")
    effect = float(proportion_effectsize(first / n, second / n))
    weak = (PAIRED,)
    if first + second in (0, 2 * n):
        return Difference(None, None, effect, weak, PROPORTION_ASTERISKS)
    statistic, p = proportions_ztest([first, second], [n, n])
    return Difference(float(statistic), float(p), effect, weak, PROPORTION_ASTERISKS)


def _variance(values: Values) -> float:
    """Return the variance with divisor n − 1, exactly 0 for equal values whatever the rounding."""
    if len(values) < 2 or bool(np.all(values == values[0])):
        return 0.0
    return float(values.var(ddof=1))
