"""An interval of a mean that holds at every number of trials, so that one may stop at any.

Student's interval promises its coverage at a number of trials that was fixed before. Whoever looks
after each trial and stops when the interval is narrow stops where the deviation happens to be
small, and is right less often. A confidence sequence (Lai 1976) holds at all numbers together.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt

import numpy as np

PRIOR_TRIALS = 1.0
"""Weight of the mixture over means, in trials: any positive one is valid, this one suits few."""


def half_width(values: Sequence[float], confidence_percent: float) -> float:
    """Return half the width of the interval around the mean of ``values``; infinite if unknown.

    Too few values are unknown, and equal ones: silent neurons have no spread to judge by. For
    independent values of one normal distribution, whatever its mean and variance: with the
    given probability the intervals after 2, 3, 4, … values all hold the mean. It is the set of
    means m that the scale-invariant likelihood ratio of values − m, mixed over normal means with
    the variance σ² / PRIOR_TRIALS, does not refuse by Ville's inequality.
    """
    n = len(values)
    if n < 2:
        return inf
    share = 1 - confidence_percent / 100
    k = ((n + PRIOR_TRIALS) / PRIOR_TRIALS / share**2) ** (1 / n)
    room = 1 - k * PRIOR_TRIALS / (n + PRIOR_TRIALS)
    if room <= 0:
        return inf
    variance = float(np.var(values, ddof=1))
    if variance == 0:
        return inf
    return sqrt((k - 1) * (n - 1) * variance / (n * room))
