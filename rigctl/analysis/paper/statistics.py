"""The paper's test of difference and its asterisks, with a sentence for each weak assumption."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse

Values = NDArray[np.float64]

ASTERISKS = (("**", 0.01, 1.0), ("*", 0.05, 0.5))
"""Figure 4's rule: p is below the first bound and the size of Cohen's d above the second."""
REDRAWN = (
    "The values compared are accuracies of repeated draws from the same trials. They are not "
    "independent, so p is smaller and d is larger than for new recordings."
)
CEILING_SHARE = 0.99


@dataclass(frozen=True, slots=True)
class Difference:
    """Welch's t, its p and Cohen's d, each None where it is not defined.

    ``assumptions``: sentences on assumptions that do not hold.
    """

    statistic: float | None
    p: float | None
    effect: float | None
    assumptions: tuple[str, ...]

    @property
    def stars(self) -> str:
        """The paper's asterisks; empty where the test is not defined."""
        return "" if self.p is None or self.effect is None else asterisks(self.p, self.effect)


def asterisks(p: float, effect: float) -> str:
    """Return ``""``, ``"*"`` or ``"**"``; the sign of the effect does not matter."""
    earned = (stars for stars, most_p, least in ASTERISKS if p < most_p and abs(effect) > least)
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


def _variance(values: Values) -> float:
    """Return the variance with divisor n − 1, exactly 0 for equal values whatever the rounding."""
    if len(values) < 2 or bool(np.all(values == values[0])):
        return 0.0
    return float(values.var(ddof=1))
