"""A foreign recording's times made sound, and its columns laid on a grid of one millisecond.

Between two rows the value goes in a straight line. Across a gap nothing is made up: samples
that fall into it are missing. Rows faster than 1 kHz pass a low-pass first, so that nothing folds
back into what is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]
GAP_PERIODS = 3.0
NEIGHBOURS = 5
LEAST_ROWS = 2
FAST_SHARE = 1.01
ORDER = 8
PAD_ROWS = 100


@dataclass(frozen=True, slots=True)
class Track:
    """Rows in rising time from 0: ``time_s`` float64 (n,), ``values`` float64 (n, m)."""

    time_s: Floats
    values: Floats

    @property
    def period_s(self) -> float:
        """Usual distance of rows."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    @property
    def rate_hz(self) -> float:
        """Mean rows a second, pauses left out."""
        steps = np.diff(self.time_s)
        usual = steps[steps <= GAP_PERIODS * self.period_s]
        return float(1.0 / usual.mean()) if usual.size else 0.0


@dataclass(frozen=True, slots=True)
class Resampled:
    """``index`` int64 (k,): which millisecond each row is; ``values`` float64 (k, m).

    ``count`` milliseconds in all, those in gaps included.
    """

    index: NDArray[np.int64]
    values: Floats
    count: int


def sound_track(
    time_s: Floats, values: Floats, first_row: int, needed: int
) -> tuple[Track, list[str]]:
    """Drop what has no time or lies before a time already seen; one row for each time.

    The first ``needed`` columns must be there in a row. Returns the track from time 0 on, and
    what was wrong in sentences.
    """
    lines = []
    holes = ~np.isfinite(time_s) | ~np.isfinite(values[:, :needed]).all(axis=1)
    if holes.any():
        row = first_row + int(np.argmax(holes))
        lines.append(f"{holes.sum()} rows lack a value, the first is row {row}: left out")
    rows = np.flatnonzero(~holes)
    time_s = time_s[rows]
    seen = np.maximum.accumulate(time_s) if len(time_s) else time_s
    back = time_s < seen
    if back.any():
        row = first_row + int(rows[np.argmax(back)])
        lines.append(f"time runs backwards before {back.sum()} rows, first row {row}: left out")
    rows, time_s = rows[~back], time_s[~back]
    starts = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0)
    repeated = len(time_s) - len(starts)
    if repeated:
        place = int(np.flatnonzero(np.diff(time_s) == 0)[0]) + 1
        row = first_row + int(rows[place])
        lines.append(f"{repeated} rows repeat a time stamp, first row {row}: averaged with it")
    if len(starts) < LEAST_ROWS:
        return Track(time_s[:0], values[:0]), lines
    counts = np.diff(np.append(starts, len(time_s)))
    means = np.add.reduceat(values[rows], starts, axis=0) / counts[:, None]
    return Track(time_s[starts] - time_s[0], means), lines


def outliers(track: Track, sigma: float) -> list[tuple[int, int, int]]:
    """Column, count and first row of values that stand out from their neighbours.

    Such a value is farther from the median of the five around it than the column usually goes
    from end to end (1st to 99th percentile), and than ``sigma`` times the usual spread of these
    differences, 1.4826 times their median.
    """
    from scipy.ndimage import median_filter

    found = []
    for column in range(track.values.shape[1]):
        values = track.values[:, column]
        away = np.abs(values - median_filter(values, NEIGHBOURS, mode="nearest"))
        low, high = np.percentile(values, (1, 99))
        far = away > max(sigma * 1.4826 * float(np.median(away)), float(high - low))
        if far.any():
            found.append((column, int(far.sum()), int(np.argmax(far))))
    return found


def is_fast(rate_hz: float) -> bool:
    """Whether rows come oftener than they are kept."""
    return rate_hz > FAST_SHARE * SAMPLE_RATE_HZ


def resample(
    track: Track, max_gap_s: float, low_pass_hz: float = 0.0
) -> tuple[Resampled, list[tuple[float, float]]]:
    """The track on a grid of 1 ms, and its gaps as (start, end) in seconds.

    ``low_pass_hz``: of the filter before rows faster than 1 kHz are thinned out, 0 for none.
    """
    limit_s = max_gap_s or GAP_PERIODS * track.period_s
    step = 1.0 / SAMPLE_RATE_HZ
    count = int(np.floor(track.time_s[-1] * SAMPLE_RATE_HZ + 1e-6)) + 1
    index = np.arange(count, dtype=np.int64)
    grid = index / SAMPLE_RATE_HZ
    breaks = np.flatnonzero(np.diff(track.time_s) > max(limit_s, 1.5 * step))
    gaps = [(float(track.time_s[k]), float(track.time_s[k + 1])) for k in breaks]
    if low_pass_hz and is_fast(track.rate_hz):
        track = _low_passed(track, breaks + 1, low_pass_hz)
    inside = np.ones(count, np.bool_)
    for start, end in gaps:
        inside &= (grid <= start + 1e-9) | (grid >= end - 1e-9)
    grid, index = grid[inside], index[inside]
    columns = [np.interp(grid, track.time_s, column) for column in track.values.T]
    return Resampled(index, np.stack(columns, axis=1), count), gaps


def _low_passed(track: Track, cuts: NDArray[np.int64], low_pass_hz: float) -> Track:
    """Each stretch without a gap through a Butterworth filter forward and backward: no delay.

    A stretch is laid on even steps first. Columns with holes stay as they are.
    """
    from scipy.signal import butter, sosfiltfilt

    rate_hz = track.rate_hz
    sections = butter(ORDER, low_pass_hz, fs=rate_hz, output="sos")
    values = track.values.copy()
    whole = np.flatnonzero(np.isfinite(values).all(axis=0))
    for rows in np.split(np.arange(len(values)), cuts):
        time_s = track.time_s[rows]
        n = max(LEAST_ROWS, round(float(time_s[-1] - time_s[0]) * rate_hz) + 1)
        even_s = np.linspace(time_s[0], time_s[-1], n)
        for column in whole:
            even = np.interp(even_s, time_s, values[rows, column])
            smooth = sosfiltfilt(sections, even, padlen=min(PAD_ROWS, n - 1))
            values[rows, column] = np.interp(time_s, even_s, smooth)
    return Track(track.time_s, values)
