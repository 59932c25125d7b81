"""The features of a session's trials, of each once, while the session grows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.component_sweep import Matrix
from rigctl.analysis.execution.executor import Progress
from rigctl.analysis.learning.complete_block import Condition
from rigctl.encoding.features import FeatureLayout, feature_matrices
from rigctl.encoding.normalisation import Normalisation
from rigctl.session.session import Session

TILE_TRIALS = 32
"""Trials that are read and encoded together."""


class GrowingFeatures:
    """Reads new committed trials, and encodes them with the session's preset and range.

    Without a calibrated range, that of the first 1, 2, 4, 8, … trials holds until there are twice
    as many; then all are encoded again, with the range of twice as many. ``features``: float64 (p,)
    by row of /trials, scaled to speed. ``changes``: how often all of them became others.
    """

    def __init__(self, folder: Path) -> None:
        self.session = Session.open(folder)
        self.features: dict[int, Matrix] = {}
        self.changes = 0
        self._parameters = self.session.header.encoder_parameters
        self._complete: dict[int, bool] = {}
        self._ends: dict[int, tuple[NDArray[np.uint16], NDArray[np.uint16]]] = {}
        self._ranges: tuple[int, Normalisation | None] = (0, self.session.header.calibrated_ranges)
        self._is_calibrated = self._ranges[1] is not None
        self._layout: FeatureLayout | None = None

    def close(self) -> None:
        """Close the session."""
        self.session.close()

    @property
    def has_calibrated_range(self) -> bool:
        """Whether the session has a calibrated range of its taxels."""
        return self._is_calibrated

    def update(self, progress: Progress = lambda stage, done, total: None) -> None:
        """Take in what was recorded since the last time."""
        self.session.refresh()
        rows = self.usable_rows()
        if not rows:
            self.features.clear()
            return
        ranges = self._range_for(rows)
        if self._layout is None:
            self._layout = self._covering(rows)
        new = [row for row in rows if row not in self.features]
        for start in range(0, len(new), TILE_TRIALS):
            progress("encoding trials", start, len(new))
            self._encode(new[start : start + TILE_TRIALS], ranges)

    def usable_rows(self) -> list[int]:
        """Return the rows of committed trials with motion and all samples, as recorded."""
        table, committed = self.session.trials, np.sort(self.session.committed())
        moving = (table["speed_mm_s"][committed] > 0) & (table["travel_mm"][committed] > 0)
        rows: list[int] = committed[moving].tolist()
        new = [row for row in rows if row not in self._complete]
        for row, place in zip(new, self.session.sample_ranges(new) if new else (), strict=True):
            self._complete[row] = place.complete and place.stop > place.start
        return [row for row in rows if self._complete[row]]

    def by_condition(self) -> dict[str, dict[Condition, list[int]]]:
        """Return the rows of encoded trials by plate and condition."""
        found: dict[str, dict[Condition, list[int]]] = {}
        for row in self.usable_rows():
            trial = self.session.trials[row]
            speed, force, depth = (
                float(trial[name]) for name in ("speed_mm_s", "force_g", "depth_mm")
            )
            cells = found.setdefault(str(trial["texture"]), {})
            cells.setdefault((speed, force, depth), []).append(row)
        return found

    def _encode(self, rows: Sequence[int], ranges: Normalisation) -> None:
        assert self._layout is not None
        samples = [self.session.readings(row) for row in rows]
        speeds = [float(self.session.trials[row]["speed_mm_s"]) for row in rows]
        (matrix,) = feature_matrices(samples, speeds, ranges, [self._layout], self._parameters)
        self.features.update(zip(rows, matrix, strict=True))

    def _range_for(self, rows: Sequence[int]) -> Normalisation:
        """Return the range for these trials; forget features of another one."""
        count, ranges = self._ranges
        first = 1 << (len(rows).bit_length() - 1)
        if ranges is not None and (self._is_calibrated or first == count):
            return ranges
        ends = [self._ends_of(row) for row in rows[:first]]
        both = [np.stack(pair) for pair in ends]
        source = f"the first {first} trials"
        ranges = Normalisation.from_samples(both, source, self._parameters.reading)
        self._ranges = first, ranges
        self._layout = self._covering(rows)
        self.features.clear()
        self.changes += 1
        return ranges

    def _ends_of(self, row: int) -> tuple[NDArray[np.uint16], NDArray[np.uint16]]:
        if row not in self._ends:
            samples = self.session.readings(row)
            self._ends[row] = samples.min(axis=0), samples.max(axis=0)
        return self._ends[row]

    def _covering(self, rows: Sequence[int]) -> FeatureLayout:
        table = self.session.trials[list(rows)]
        counts, speeds = table["count"].tolist(), table["speed_mm_s"].tolist()
        return FeatureLayout.covering(counts, speeds, scaled=True)
