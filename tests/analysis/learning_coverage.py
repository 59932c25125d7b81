"""Measure how often the interval of a learning curve holds the accuracy that it estimates.

``python -m tests.analysis.learning_coverage SESSION DRAWS`` draws trials from a large virtual
session again and again, as if each draw were a session of its own. The true accuracy is the mean
over the draws: that of classifiers trained with as many trials as a fold has.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.learning_curve import (
    CurvePoint,
    GrowingCurve,
    RecordedTrials,
    learning_curve,
)

Features = dict[int, NDArray[np.float64]]


class Coverage(NamedTuple):
    """Of intervals at ``n_trials`` a condition: the share that holds the mean accuracy."""

    n_trials: int
    accuracy: float
    share: float
    half_width: float


def measure(
    trials: RecordedTrials, features: Features, n_trials: int, draws: int, seed: int = 0
) -> Coverage:
    """Return the coverage over draws of ``n_trials`` trials of each plate and condition."""
    random = np.random.default_rng([seed, n_trials])
    points = [_last_point(trials, features, n_trials, random) for _ in range(draws)]
    accuracy = float(np.mean([point.accuracy for point in points]))
    held = [point.low <= accuracy <= point.high for point in points]
    width = float(np.mean([point.high - point.low for point in points]))
    return Coverage(n_trials, accuracy, float(np.mean(held)), width / 2)


def _last_point(
    trials: RecordedTrials, features: Features, n_trials: int, random: np.random.Generator
) -> CurvePoint:
    drawn = {
        plate: {key: random.permutation(rows)[:n_trials].tolist() for key, rows in cells.items()}
        for plate, cells in trials.items()
    }
    return learning_curve(drawn, features, {})[-1]


def main() -> None:
    """Print a row for each number of trials."""
    growing = GrowingCurve(Path(sys.argv[1]))
    trials = growing.update()
    print("trials a condition, accuracy, coverage, half width")
    for n_trials in (2, 4, 8, 16):
        found = measure(trials, growing.features, n_trials, int(sys.argv[2]))
        print(f"{n_trials:>4} {found.accuracy:.3f} {found.share:.3f} {found.half_width:.3f}")
    growing.session.close()


if __name__ == "__main__":
    main()
