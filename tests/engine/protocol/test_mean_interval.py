"""The interval of a mean that may be looked at after each value."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from scipy import stats

from rigctl.engine.early_end import PRIOR_TRIALS, half_width


def test_the_ends_are_where_the_mixture_ratio_is_one_over_alpha() -> None:
    values = np.random.default_rng(0).normal(30, 2, 9)
    n, prior = len(values), PRIOR_TRIALS
    shifted = values - (values.mean() + half_width(values.tolist(), 95))
    squares, total = float(shifted @ shifted), float(shifted.sum())
    ratio = sqrt(prior / (n + prior)) * (squares / (squares - total**2 / (n + prior))) ** (n / 2)
    assert abs(ratio - 20) < 1e-9
    assert half_width([1.0], 95) == half_width([0.0] * 20, 95) == inf


def test_stopping_when_it_is_narrow_keeps_the_promise_that_students_breaks() -> None:
    random = np.random.default_rng(4)
    right = {"sequence": 0, "student": 0}
    runs = 400
    for _ in range(runs):
        values = random.normal(0, 1, 200)
        for name, width in (("sequence", half_width), ("student", student)):
            stop = next(n for n in range(5, 201) if width(values[:n].tolist(), 95) < 0.6)
            right[name] += abs(float(values[:stop].mean())) < width(values[:stop].tolist(), 95)
    assert right["sequence"] / runs > 0.95
    assert right["student"] / runs < 0.93


def student(values: list[float], confidence_percent: float) -> float:
    n = len(values)
    t = float(stats.t.ppf(0.5 + confidence_percent / 200, n - 1))
    return t * float(np.std(values, ddof=1)) / sqrt(n)
