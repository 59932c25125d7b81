"""What a frame of the movie shows: the values that were there at its moment."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.animation.movie import FRAME_S
from rigctl.analysis.finger.movie.scan_timeline import ScanTimeline
from rigctl.finger_values import PredictionRow

LEAD_S = 0.4
"""The movie begins before the first mark and ends after the second one."""
TRAIL_S = 0.4


class MovieFrame(NamedTuple):
    """The values at ``at_s``, counted: the first ``n_readings`` of the readings, and so on.

    ``scan_s``: the time of the scan so far, from 0 to its end.
    ``finger_mm``: along and across the plate; None without a position so far. ``spikes``: bool
    (k,), those that the board has scaled. ``distance_mm``: from the start of the scan, by the
    tracker.
    """

    at_s: float
    scan_s: float
    finger_mm: tuple[float, float] | None
    n_positions: int
    n_readings: int
    n_batches: int
    spikes: NDArray[np.bool_]
    n_windows: int
    answer: PredictionRow | None
    distance_mm: float


def frame_times(timeline: ScanTimeline) -> NDArray[np.float64]:
    """Return the moments of the frames, float64 (frames,), evenly spaced."""
    last_s = max([timeline.duration_s, *timeline.answer_s.tolist()]) + TRAIL_S
    n_frames = int(np.ceil((last_s + LEAD_S) / FRAME_S)) + 1
    return FRAME_S * np.arange(n_frames, dtype=np.float64) - LEAD_S


def frame_at(timeline: ScanTimeline, at_s: float) -> MovieFrame:
    """Return what was there at a moment, in seconds since the scan's first sample."""
    n_positions = _count(timeline.track_s, at_s)
    finger = None
    if n_positions:
        last = n_positions - 1
        finger = float(timeline.along_mm[last]), float(timeline.across_mm[last])
    n_answers = _count(timeline.answer_s, at_s)
    return MovieFrame(
        at_s=at_s,
        scan_s=float(np.clip(at_s, 0.0, timeline.duration_s)),
        finger_mm=finger,
        n_positions=n_positions,
        n_readings=_count(timeline.reading_s, at_s),
        n_batches=_count(timeline.batch_known_s, at_s),
        spikes=timeline.spike_known_s <= at_s,
        n_windows=_count(timeline.window_known_s, at_s),
        answer=timeline.answers[n_answers - 1] if n_answers else None,
        distance_mm=_distance_mm(timeline, at_s),
    )


def _count(times_s: NDArray[np.float64], at_s: float) -> int:
    return int(np.searchsorted(times_s, at_s, side="right"))


def _distance_mm(timeline: ScanTimeline, at_s: float) -> float:
    """Return the way between the scan's start and a moment of it."""
    if not len(timeline.track_s):
        return 0.0
    until_s = float(np.clip(at_s, 0.0, timeline.duration_s))
    here, start = np.interp([until_s, 0.0], timeline.track_s, timeline.along_mm)
    return float(here - start)
