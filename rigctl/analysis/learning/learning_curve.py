"""Held-out accuracy against the number of trials of each plate and condition, with its interval."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rigctl.analysis.classification.component_sweep import Labels, Matrix
from rigctl.analysis.classification.held_out import (
    MAX_COMPONENTS,
    N_FOLDS,
    SHOWN_COMPONENTS,
    TASK,
)
from rigctl.analysis.classification.splits import Fold, Split, stratified_folds
from rigctl.analysis.classification.sweep_engines import SweepEngine, predict_splits
from rigctl.analysis.learning.complete_block import RecordedTrials, largest_block, rows_of
from rigctl.analysis.paper.statistics import wilson_interval

STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
"""Numbers of trials that have a point, beside the highest number so far."""
SEED = 0


class CurvePoint(NamedTuple):
    """Accuracy with ``n_trials`` of each plate and condition.

    ``right`` of ``tested`` held-out trials were named; ``low``, ``high``: 95 % Wilson interval of
    the share; ``chance``: that of guessing. ``trained``: fewest training trials of a fold.
    """

    n_trials: int
    plates: tuple[str, ...]
    n_conditions: int
    trained: int
    tested: int
    right: int
    low: float
    high: float

    @property
    def accuracy(self) -> float:
        """Share of the held-out trials that were named right."""
        return self.right / self.tested

    @property
    def chance(self) -> float:
        """Accuracy of guessing: each plate has as many trials as the others."""
        return 1 / len(self.plates)


class LearningCurve:
    """Points for the trials so far; a point whose trials are the same as before is kept."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[tuple[int, ...], CurvePoint]] = {}

    def forget(self) -> None:
        """Compute every point anew, as the features have changed."""
        self._known.clear()

    def points(
        self, trials: RecordedTrials, features: Mapping[int, Matrix]
    ) -> tuple[CurvePoint, ...]:
        """Return the points that the trials allow; ``features``: float64 (p,) by row."""
        most = max((len(rows) for cells in trials.values() for rows in cells.values()), default=0)
        found = (self._point(trials, features, n) for n in _steps(trials, most))
        return tuple(point for point in found if point is not None)

    def _point(
        self, trials: RecordedTrials, features: Mapping[int, Matrix], n_trials: int
    ) -> CurvePoint | None:
        block = largest_block(trials, n_trials)
        rows = tuple(rows_of(trials, block, n_trials))
        known, point = self._known.get(n_trials, ((), None))
        if point is not None and known == rows:
            return point
        each = n_trials * len(block.conditions)
        labels = np.repeat(np.arange(len(block.plates)), each).astype(np.int64)
        folds = _folds(labels, each)
        if not folds:
            return None
        matrix = np.array([features[row] for row in rows])
        right = int(np.sum(predict_held_out(matrix, labels, folds) == labels))
        low, high = wilson_interval(right, len(rows))
        trained = min(len(train) for train, _ in folds)
        counts = (len(block.conditions), trained, len(rows), right)
        point = CurvePoint(n_trials, block.plates, *counts, float(low), float(high))
        self._known[n_trials] = rows, point
        return point


def predict_held_out(features: Matrix, labels: Labels, folds: list[Fold]) -> Labels:
    """Return the class that each row is given by PCA and LDA without it: int64 (n,).

    The number of components is chosen in advance, as for the quick check.
    """
    smallest = min(len(train) for train, _ in folds)
    room = min(MAX_COMPONENTS, smallest - len(np.unique(labels)), features.shape[1])
    k = min(SHOWN_COMPONENTS, max(1, room // 2))
    splits = [Split(train, {TASK: test}) for train, test in folds]
    sweeps = predict_splits(features, {TASK: labels}, splits, k, SweepEngine.OWN)
    predictions = np.empty(len(labels), np.int64)
    for (_, test), sweep in zip(folds, sweeps, strict=True):
        predictions[test] = sweep.predictions[TASK][k - 1]
    return predictions


def _folds(labels: Labels, each: int) -> list[Fold]:
    """Return the folds of classes of ``each`` trials; none where they are too few to train on."""
    if len(labels) == 0 or each < 2:
        return []
    folds = stratified_folds(labels, min(N_FOLDS, each), SEED)
    smallest = min(len(train) for train, _ in folds)
    return folds if smallest > len(np.unique(labels)) else []


def _steps(trials: RecordedTrials, most: int) -> list[int]:
    """Return the numbers of trials to compute, the highest that a block has at the end."""
    steps = [n for n in STEPS if n <= most]
    while most and not largest_block(trials, most).plates:
        most -= 1
    return sorted({*(n for n in steps if n < most), most} - {0})
