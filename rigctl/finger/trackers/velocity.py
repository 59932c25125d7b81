"""The mean velocity of the finger along the plate over each batch, from a tracker's positions."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from math import dist
from typing import NamedTuple

from rigctl.errors import WrongUse
from rigctl.finger.trackers.plate_frame import PlateFrame, PlatePosition
from rigctl.values import Position

MAX_SPEED_MM_S = 2000.0
"""No finger explores a texture this fast; plausible, some 10 times the paper's fast scans."""
MAX_ACCELERATION_MM_S2 = 20_000.0
"""2 g: a hand that does not hit something stays below; plausible."""
NOISE_MM = 5.0
"""A position may be this far from where the path leads; trackers have 0.1 to 1 mm of noise."""
CONFIRMING = 3
"""Positions in a row that agree with each other and not with the path before."""
KEEP_S = 30.0
"""A batch or a mark is asked for within a second; a slide takes less than 10 s."""
_LEAD_S = 0.02
"""The direction of the path is that of this last time: shorter is noise."""


class _Point(NamedTuple):
    at_s: float
    place_mm: tuple[float, float, float]
    follows: bool
    """False: the tracker jumped before this point; between the two the path is unknown."""


class Stretch(NamedTuple):
    """The path between two times: where it starts and ends along the plate, the gaps in it that
    are longer than asked for, and its positions. ``whole``: the tracker did not jump within it.
    """

    start_mm: float
    end_mm: float
    gaps_s: tuple[float, ...]
    positions: int
    whole: bool


@dataclass(slots=True)
class PathCounters:
    """Positions since construction: all, flagged invalid by the tracker, single jumps that were
    left out, times that did not ascend; and how often the tracker found itself again elsewhere.
    """

    positions: int = 0
    invalid: int = 0
    outliers: int = 0
    out_of_order: int = 0
    relocations: int = 0


class FingerPath:
    """The path of the last 30 s."""

    def __init__(self) -> None:
        self.counters = PathCounters()
        self.heard_s = float("-inf")
        """Time of the newest position, whether it was taken or not."""
        self._points: list[_Point] = []
        self._suspects: list[_Point] = []
        self._outliers_s: list[float] = []

    @property
    def known_s(self) -> float:
        """Time up to which the path is known."""
        return self._points[-1].at_s if self._points else float("-inf")

    @property
    def begins_s(self) -> float:
        """Time from which the path is known."""
        return self._points[0].at_s if self._points else float("inf")

    def add(self, position: PlatePosition) -> None:
        """Add a position on the plate."""
        self.counters.positions += 1
        if position.at_s <= self.heard_s:
            self.counters.out_of_order += 1
            return
        self.heard_s = position.at_s
        if not position.valid:
            self.counters.invalid += 1
            return
        point = _Point(position.at_s, position[1:4], True)
        if not self._points or self._continues(point):
            self._drop_suspects()
            self._points.append(point)
            self._forget()
        else:
            self._suspect(point)

    def along_mm(self, at_s: float) -> float:
        """Return the place along the plate at a time within the path, linearly interpolated."""
        after = bisect_left(self._points, at_s, key=_time)
        second = self._points[after]
        if second.at_s == at_s:
            return second.place_mm[0]
        first = self._points[after - 1]
        share = (at_s - first.at_s) / (second.at_s - first.at_s)
        return first.place_mm[0] + share * (second.place_mm[0] - first.place_mm[0])

    def stretch(self, start_s: float, end_s: float, shortest_gap_s: float) -> Stretch:
        """Return the path between two times within it, with its gaps above ``shortest_gap_s``."""
        first = bisect_right(self._points, start_s, key=_time) - 1
        last = bisect_left(self._points, end_s, key=_time)
        points = self._points[first : last + 1]
        gaps_s = (after.at_s - before.at_s for before, after in pairwise(points))
        return Stretch(
            self.along_mm(start_s),
            self.along_mm(end_s),
            tuple(gap_s for gap_s in gaps_s if gap_s > shortest_gap_s),
            sum(start_s <= point.at_s <= end_s for point in points),
            all(point.follows for point in points[1:]),
        )

    def outliers(self, start_s: float, end_s: float) -> int:
        """Return the number of single jumps that were left out between two times."""
        return sum(start_s <= at_s <= end_s for at_s in self._outliers_s)

    def _continues(self, point: _Point) -> bool:
        """Return whether the point is where the last positions lead, and no faster than a hand."""
        last = self._points[-1]
        if not _is_reachable(last, point):
            return False
        after_s = point.at_s - last.at_s
        led_to = [
            place + speed * after_s
            for place, speed in zip(last.place_mm, self._velocity(), strict=True)
        ]
        reach_mm = NOISE_MM + 0.5 * MAX_ACCELERATION_MM_S2 * after_s * after_s
        return dist(led_to, point.place_mm) <= reach_mm

    def _velocity(self) -> tuple[float, ...]:
        """Return the velocity of the last 20 ms in mm/s, 0 of a single position."""
        last = before = self._points[-1]
        for point in reversed(self._points):
            before = point
            if last.at_s - point.at_s >= _LEAD_S or not point.follows:
                break
        passed_s = last.at_s - before.at_s
        if passed_s == 0.0:
            return (0.0, 0.0, 0.0)
        places = zip(before.place_mm, last.place_mm, strict=True)
        return tuple((to - came) / passed_s for came, to in places)

    def _suspect(self, point: _Point) -> None:
        if self._suspects and not _is_reachable(self._suspects[-1], point):
            self._drop_suspects()
        self._suspects.append(point)
        if len(self._suspects) < CONFIRMING:
            return
        first = self._suspects[0]
        moved = _is_reachable(self._points[-1], first)
        self.counters.relocations += not moved
        self._points += [first._replace(follows=moved), *self._suspects[1:]]
        self._suspects.clear()

    def _drop_suspects(self) -> None:
        self.counters.outliers += len(self._suspects)
        self._outliers_s += [suspect.at_s for suspect in self._suspects]
        self._suspects.clear()

    def _forget(self) -> None:
        """Drop what is older than twice the time to keep, so that it happens rarely."""
        oldest_s = self.known_s - KEEP_S
        if self._points[0].at_s < oldest_s - KEEP_S:
            del self._points[: bisect_left(self._points, oldest_s, key=_time)]
            self._outliers_s = [at_s for at_s in self._outliers_s if at_s >= oldest_s]


def _time(point: _Point) -> float:
    return point.at_s


def _is_reachable(first: _Point, second: _Point) -> bool:
    most_mm = NOISE_MM + MAX_SPEED_MM_S * (second.at_s - first.at_s)
    return dist(first.place_mm, second.place_mm) <= most_mm


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
