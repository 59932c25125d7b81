"""The mean velocity of the finger along the plate over each batch, from a tracker's positions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from rigctl.devices.trackers.path import FingerPath
from rigctl.devices.trackers.plate_frame import PlateFrame, PlatePosition
from rigctl.errors import WrongUse
from rigctl.values import Position

MISSED_S = 0.03
"""Positions farther apart than this are a dropout: a source needs at least 50 positions/s."""
BRIDGED_S = 0.1
"""A dropout up to this length, one batch, is bridged by a straight line."""


class EstimateSource(StrEnum):
    """Where the velocity of a batch comes from.

    MEASURED: positions throughout. INTERPOLATED: across a dropout of at most 100 ms. HELD: the
    velocity of the batch before, because the path is unknown for longer.
    """

    MEASURED = "measured"
    INTERPOLATED = "interpolated"
    HELD = "held"


class BatchVelocity(NamedTuple):
    """Mean velocity over a batch.

    ``mm_s`` is negative where the finger went back; ``um_per_s`` is what the board takes, 0 then.
    ``dropouts`` and ``outliers`` lie within the batch, ``positions`` were used.
    """

    mm_s: float
    um_per_s: int
    source: EstimateSource
    dropouts: int
    outliers: int
    positions: int


@dataclass(slots=True)
class EstimatorCounters:
    """Estimates since construction, by source, and those of a finger that went back."""

    measured: int = 0
    interpolated: int = 0
    held: int = 0
    reversed: int = 0
    dropouts: int = 0


class VelocityEstimator:
    """Positions in, mean velocities along the plate out.

    The mean velocity is the displacement between the two ends of the batch over its time, with
    both ends interpolated linearly between positions: exact for any velocity that is constant
    between positions. White noise of σ mm gives an error of √2·σ/0.1 s.
    """

    def __init__(self, frame: PlateFrame) -> None:
        self.counters = EstimatorCounters()
        self.latest: PlatePosition | None = None
        """The newest position, whether it was taken or not."""
        self._frame = frame
        self._path = FingerPath()
        self.path_counters = self._path.counters
        self._last_mm_s = 0.0

    def add(self, position: Position) -> None:
        """Add a position in the tracker's frame; positions come in order of time."""
        self.latest = self._frame.to_plate(position)
        self._path.add(self.latest)

    def begin_scan(self) -> None:
        """Forget the velocity to hold: a scan whose first batch has no path begins with 0."""
        self._last_mm_s = 0.0

    def mean_velocity(
        self, start_s: float, end_s: float, now_s: float | None = None
    ) -> BatchVelocity | None:
        """Return the mean velocity over exactly [start_s, end_s]; ask once for each batch.

        None: positions do not reach ``end_s`` yet. ``now_s``, the loop's time, ends the wait for
        a silent tracker 100 ms after its last position. Raises WrongUse for an empty interval.
        """
        if end_s <= start_s:
            raise WrongUse(f"a batch from {start_s:g} to {end_s:g} s has no duration")
        path = self._path
        if path.known_s < end_s:
            heard_s = max(path.heard_s, path.heard_s if now_s is None else now_s)
            lost = heard_s - max(path.known_s, start_s - BRIDGED_S) > BRIDGED_S and heard_s >= end_s
            return self._hold(start_s, end_s) if lost else None
        if path.begins_s > start_s:
            return self._hold(start_s, end_s)
        stretch = path.stretch(start_s, end_s, MISSED_S)
        if not stretch.whole or max(stretch.gaps_s, default=0.0) > BRIDGED_S:
            return self._hold(start_s, end_s, len(stretch.gaps_s), stretch.positions)
        self._last_mm_s = (stretch.end_mm - stretch.start_mm) / (end_s - start_s)
        source = EstimateSource.INTERPOLATED if stretch.gaps_s else EstimateSource.MEASURED
        return self._report(start_s, end_s, source, len(stretch.gaps_s), stretch.positions)

    def along_mm(self, at_s: float) -> float | None:
        """Return the place along the plate at a time; None where the path is not known there."""
        path = self._path
        if not path.begins_s <= at_s <= path.known_s:
            return None
        stretch = path.stretch(at_s, at_s, BRIDGED_S)
        return stretch.start_mm if stretch.whole and not stretch.gaps_s else None

    def _hold(
        self, start_s: float, end_s: float, dropouts: int = 1, positions: int = 0
    ) -> BatchVelocity:
        return self._report(start_s, end_s, EstimateSource.HELD, dropouts, positions)

    def _report(
        self, start_s: float, end_s: float, source: EstimateSource, dropouts: int, positions: int
    ) -> BatchVelocity:
        mm_s, counters = self._last_mm_s, self.counters
        counters.measured += source is EstimateSource.MEASURED
        counters.interpolated += source is EstimateSource.INTERPOLATED
        counters.held += source is EstimateSource.HELD
        counters.reversed += mm_s < 0
        counters.dropouts += dropouts
        outliers = self._path.outliers(start_s, end_s)
        um_per_s = max(0, round(mm_s * 1000.0))
        return BatchVelocity(mm_s, um_per_s, source, dropouts, outliers, positions)
