"""The learning curve of a session, which may still be recorded, and what it says in words.

Held-out accuracy against the number of trials of each plate and condition, with its interval.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rigctl.analysis.executors import Progress
from rigctl.analysis.held_out import MAX_COMPONENTS, N_FOLDS, SHOWN_COMPONENTS, TASK
from rigctl.analysis.pca_lda import Labels, Matrix, Split, SweepEngine, predict_splits
from rigctl.analysis.splits import Fold, stratified_folds
from rigctl.analysis.statistics import wilson_interval
from rigctl.encoder.features import FeatureLayout, feature_matrices
from rigctl.encoder.normalisation import Normalisation
from rigctl.session.session import Session, rows_by_condition

Condition = tuple[float, float, float]
"""Speed in mm/s, force in g, depth in mm."""
RecordedTrials = Mapping[str, Mapping[Condition, Sequence[int]]]
"""Rows of the trials of each plate by their condition, in the order of recording."""
TILE_TRIALS = 32
"""Trials that are read and encoded together."""
STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
"""Numbers of trials that have a point, beside the highest number so far."""
SEED = 0


def largest_block(
    trials: RecordedTrials, n_trials: int
) -> tuple[tuple[str, ...], tuple[Condition, ...]]:
    """Return the most plates × conditions with at least ``n_trials`` each; empty for one plate.

    A plate that is still being recorded takes part as soon as the block grows by it: a classifier
    that knew one plate at one speed only would tell speeds apart, not plates.
    """
    full = {
        plate: frozenset(key for key, rows in cells.items() if len(rows) >= n_trials)
        for plate, cells in trials.items()
    }
    blocks: list[tuple[tuple[str, ...], tuple[Condition, ...]]] = [((), ())]
    for conditions in set(full.values()) - {frozenset()}:
        plates = tuple(sorted(plate for plate, has in full.items() if has >= conditions))
        if len(plates) > 1:
            blocks.append((plates, tuple(sorted(conditions))))
    # By their cells, then their plates, then something fixed.
    return max(blocks, key=lambda b: (len(b[0]) * len(b[1]), len(b[0]), b[1]))


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


KnownPoints = dict[tuple[int, ...], CurvePoint | None]
"""Points by the rows of their trials; None where these are too few to train on."""


def learning_curve(
    trials: RecordedTrials, features: Mapping[int, Matrix], known: KnownPoints
) -> tuple[CurvePoint, ...]:
    """Return the points that the trials allow; ``features``: float64 (p,) by row.

    ``known``: those of before, replaced by these; one whose trials are the same is kept.
    """
    before = dict(known)
    known.clear()
    most = max((len(rows) for cells in trials.values() for rows in cells.values()), default=0)
    while most and not largest_block(trials, most)[0]:
        most -= 1
    for n_trials in sorted({*(n for n in STEPS if n < most), most} - {0}):
        plates, conditions = largest_block(trials, n_trials)
        each = [trials[plate][key][:n_trials] for plate in plates for key in conditions]
        rows = tuple(row for some in each for row in some)
        point = before.get(rows) or _point(plates, len(conditions), n_trials, rows, features)
        known[rows] = point
    return tuple(point for point in known.values() if point is not None)


def _point(
    plates: tuple[str, ...],
    n_conditions: int,
    n_trials: int,
    rows: tuple[int, ...],
    features: Mapping[int, Matrix],
) -> CurvePoint | None:
    """Return the point of some trials; None where they are too few to train on."""
    each = n_trials * n_conditions
    labels = np.repeat(np.arange(len(plates)), each).astype(np.int64)
    if not rows or each < 2:
        return None
    folds = stratified_folds(labels, min(N_FOLDS, each), SEED)
    trained = min(len(train) for train, _ in folds)
    if trained <= len(plates):
        return None
    matrix = np.array([features[row] for row in rows])
    right = int(np.sum(predict_held_out(matrix, labels, folds) == labels))
    low, high = wilson_interval(right, len(rows))
    counts = (n_conditions, trained, len(rows), right)
    return CurvePoint(n_trials, plates, *counts, float(low), float(high))


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


class SessionCurve(NamedTuple):
    """The points of a session's learning curve.

    ``trials``: those that it may use; ``committed``: all that count. ``shortfall``: why there is no
    point yet, empty where there is one. ``remarks``: sentences on what the curve holds.
    """

    folder: str
    points: tuple[CurvePoint, ...] = ()
    trials: int = 0
    committed: int = 0
    simulated: bool = False
    shortfall: str = ""
    remarks: tuple[str, ...] = ()


class GrowingCurve:
    """Reads new committed trials, and encodes them with the session's preset and range.

    Without a calibrated range, that of the first 1, 2, 4, 8, … trials holds until there are twice
    as many; then all are encoded again, with the range of twice as many. ``features``: float64 (p,)
    by row of /trials, scaled to speed.
    """

    def __init__(self, folder: Path) -> None:
        self.session = Session.open(folder)
        self.features: dict[int, Matrix] = {}
        self.has_calibrated_range = self.session.header.calibrated_ranges is not None
        self._points: KnownPoints = {}
        self._parameters = self.session.header.encoder_parameters
        self._complete: dict[int, bool] = {}
        self._n_ranged = 0
        self._ranges = self.session.header.calibrated_ranges
        self._layout: FeatureLayout | None = None

    def curve(self, progress: Progress = lambda stage, done, total: None) -> SessionCurve:
        """Return the curve of the trials so far. Raises SessionError."""
        trials = self.update(progress)
        progress("classifying", 0, 1)
        points = learning_curve(trials, self.features, self._points)
        used = sum(len(rows) for cells in trials.values() for rows in cells.values())
        committed = len(self.session.committed())
        shortfall = "" if points else describe_shortfall(trials)
        remarks = _remarks(trials, points, committed - used, self.has_calibrated_range)
        of_all = (used, committed, self.session.header.simulated)
        return SessionCurve(str(self.session.path), points, *of_all, shortfall, tuple(remarks))

    def update(self, progress: Progress = lambda stage, done, total: None) -> RecordedTrials:
        """Take in what was recorded since the last time; return the trials that may be used."""
        self.session.refresh()
        rows = self._usable_rows()
        if rows:
            self._encode_new(rows, progress)
        else:
            self.features.clear()
        found: dict[str, dict[Condition, list[int]]] = {}
        for (plate, *levels), of_condition in rows_by_condition(self.session, rows).items():
            found.setdefault(plate, {})[levels[0], levels[1], levels[2]] = of_condition
        return found

    def _usable_rows(self) -> list[int]:
        """Return the rows of committed trials with motion and all samples, as recorded."""
        table, committed = self.session.trials, np.sort(self.session.committed())
        moving = (table["speed_mm_s"][committed] > 0) & (table["travel_mm"][committed] > 0)
        rows: list[int] = committed[moving].tolist()
        new = [row for row in rows if row not in self._complete]
        for row, place in zip(new, self.session.sample_ranges(new) if new else (), strict=True):
            self._complete[row] = place.complete and place.stop > place.start
        return [row for row in rows if self._complete[row]]

    def _encode_new(self, rows: Sequence[int], progress: Progress) -> None:
        ranges = self._range_for(rows)
        if self._layout is None:
            table = self.session.trials[list(rows)]
            counts, speeds = table["count"].tolist(), table["speed_mm_s"].tolist()
            self._layout = FeatureLayout.covering(counts, speeds, scaled=True)
        new = [row for row in rows if row not in self.features]
        for start in range(0, len(new), TILE_TRIALS):
            progress("encoding trials", start, len(new))
            tile = new[start : start + TILE_TRIALS]
            samples = [self.session.readings(row) for row in tile]
            speeds = self.session.trials["speed_mm_s"][tile].tolist()
            layouts = [self._layout]
            gain = self.session.header.gain(ranges)
            gains = [gain] * len(tile) if gain else ()
            (matrix,) = feature_matrices(
                samples, speeds, ranges, layouts, self._parameters, gains=gains
            )
            self.features.update(zip(tile, matrix, strict=True))

    def _range_for(self, rows: Sequence[int]) -> Normalisation:
        """Return the range for these trials; forget features of another one."""
        first = 1 << (len(rows).bit_length() - 1)
        if self._ranges is not None and (self.has_calibrated_range or first == self._n_ranged):
            return self._ranges
        readings = map(self.session.readings, rows[:first])
        ends = [np.stack((one.min(axis=0), one.max(axis=0))) for one in readings]
        source = f"the first {first} trials"
        self._ranges = Normalisation.from_samples(ends, source, self._parameters.reading)
        self._n_ranged, self._layout = first, None
        self.features.clear()
        self._points.clear()
        return self._ranges


def describe_shortfall(trials: RecordedTrials) -> str:
    """Return which trials the first point still needs."""
    counts = {plate: sum(map(len, cells.values())) for plate, cells in trials.items()}
    if not counts:
        return "Not enough trials yet: no complete trial with motion is recorded."
    so_far = ", ".join(f"{plate} has {n}" for plate, n in sorted(counts.items()))
    if len(counts) == 1:
        return f"Not enough trials yet: two plates are needed to tell them apart; {so_far}."
    return (
        "Not enough trials yet: two plates need three trials each, at the same speeds and forces; "
        f"{so_far}."
    )


def _remarks(
    trials: RecordedTrials, points: Sequence[CurvePoint], without: int, is_calibrated: bool
) -> list[str]:
    lines = []
    if not is_calibrated:
        lines.append(
            "No calibrated range of the taxels: that of the first trials holds, and the curve "
            "changes when there are twice as many"
        )
    waiting = sorted(set(trials) - set(points[-1].plates)) if points else []
    if waiting:
        lines.append(f"Without {', '.join(waiting)}: too few trials for the last point")
    if without:
        trials_are = "trial is" if without == 1 else "trials are"
        lines.append(f"{without} {trials_are} left out: no motion, or samples are missing")
    return lines
