"""Cleaning of a recording's time column, and resampling of its columns to a grid of 1 ms.

Values are interpolated linearly between two rows. Nothing is interpolated across a gap: its
samples are missing. Rows faster than 1 kHz pass a low-pass filter first, against aliasing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.values import SAMPLE_RATE_HZ

Floats = NDArray[np.float64]
GAP_PERIODS = 3.0
MEDIAN_ROWS = 5
MIN_ROWS = 2
FAST_SHARE = 1.01
FILTER_ORDER = 8
PAD_ROWS = 100
FEWEST_STEPS = 20
REPEATED_SHARE, GAP_SHARE = 0.3, 0.05
"""Fewer rows with one time are a stamp in whole milliseconds, fewer gaps are lost packets."""
OVERFLOW = 2.0**32


@dataclass(frozen=True, slots=True)
class TimeSeries:
    """Rows in ascending time from 0: ``time_s`` float64 (n,), ``values`` float64 (n, m)."""

    time_s: Floats
    values: Floats

    @property
    def period_s(self) -> float:
        """Median interval of rows."""
        return float(np.median(np.diff(self.time_s))) if len(self.time_s) > 1 else 0.0

    @property
    def rate_hz(self) -> float:
        """Mean rows a second, gaps left out."""
        steps = np.diff(self.time_s)
        regular = steps[steps <= GAP_PERIODS * self.period_s]
        return float(1.0 / regular.mean()) if regular.size else 0.0


def burst_rate(times: Floats) -> float:
    """Return rows per unit of time where many share a time or come in bursts; 0 where they do not.

    ``times``: float64 (n,). What a bus or a coarse clock stamps so says when rows arrived, not
    when they were measured. The rate is that from the first beginning of a burst to the last.
    """
    times = _longest_rise(times[np.isfinite(times)])
    steps = np.diff(times)
    ahead = steps[steps > 0]
    if len(steps) < FEWEST_STEPS or not len(ahead):
        return 0.0
    longest = GAP_PERIODS * float(np.median(ahead))
    begins = np.flatnonzero(steps > (longest if np.mean(ahead > longest) > GAP_SHARE else 0)) + 1
    share_times = len(ahead) < (1 - REPEATED_SHARE) * len(steps)
    if len(begins) < MIN_ROWS or not (share_times or np.mean(ahead > longest) > GAP_SHARE):
        return 0.0
    return float((begins[-1] - begins[0]) / (times[begins[-1]] - times[begins[0]]))


def _longest_rise(times: Floats) -> Floats:
    """Return the longest stretch in which no time is before another one."""
    stretches = np.split(times, np.flatnonzero(np.diff(times) < 0) + 1)
    return max(stretches, key=len)


def unwrap_clock(times: Floats) -> tuple[Floats, int]:
    """Return the times of a counter of 32 bits without its overflows, and how many there were.

    ``micros()`` of an Arduino begins again at 0 after 71 minutes.
    """
    known = np.where(np.isfinite(times), times, 0.0)
    falls = np.diff(known, prepend=known[:1]) < -OVERFLOW / 2
    if not falls.any() or known.min() < 0 or known.max() >= OVERFLOW:
        return times, 0
    return times + OVERFLOW * np.cumsum(falls), int(np.count_nonzero(falls))


@dataclass(frozen=True, slots=True)
class ResampledSeries:
    """``index`` int64 (k,): the millisecond of each row; ``values`` float64 (k, m).

    ``count``: milliseconds in all, those in gaps included.
    """

    index: NDArray[np.int64]
    values: Floats
    count: int


def clean_time_column(
    time_s: Floats, values: Floats, row_numbers: NDArray[np.int64], n_required: int
) -> tuple[TimeSeries, list[str]]:
    """Return rows in ascending time from 0, one for each time, and remarks on the others.

    Drops rows without a time or without a value in one of the first ``n_required`` columns, and
    rows earlier than a previous row; averages rows of one time. ``row_numbers``: int64 (n,), the
    line of each row in its file.
    """
    remarks = []
    incomplete = ~np.isfinite(time_s) | ~np.isfinite(values[:, :n_required]).all(axis=1)
    if incomplete.any():
        row = row_numbers[np.argmax(incomplete)]
        remarks.append(f"{incomplete.sum()} rows lack a value, the first is row {row}: left out")
    rows = np.flatnonzero(~incomplete)
    time_s = time_s[rows]
    latest = np.maximum.accumulate(time_s) if len(time_s) else time_s
    back = time_s < latest
    if back.any():
        row = row_numbers[rows[np.argmax(back)]]
        remarks.append(f"time runs backwards before {back.sum()} rows, first row {row}: left out")
    rows, time_s = rows[~back], time_s[~back]
    starts = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0)
    repeated = len(time_s) - len(starts)
    if repeated:
        place = int(np.flatnonzero(np.diff(time_s) == 0)[0]) + 1
        row = row_numbers[rows[place]]
        remarks.append(f"{repeated} rows repeat a time stamp, first row {row}: averaged with it")
    if len(starts) < MIN_ROWS:
        return TimeSeries(time_s[:0], values[:0]), remarks
    counts = np.diff(np.append(starts, len(time_s)))
    means = np.add.reduceat(values[rows], starts, axis=0) / counts[:, None]
    return TimeSeries(time_s[starts] - time_s[0], means), remarks


def find_outliers(series: TimeSeries, sigma: float) -> list[tuple[int, int, int]]:
    """Return (column, count, first row) of the outliers in each column that has any.

    An outlier differs from the median of the five values around it by more than the column's
    range (1st to 99th percentile), and by more than ``sigma`` standard deviations of these
    differences, estimated as 1.4826 times their median.
    """
    from scipy.ndimage import median_filter

    found = []
    for column in range(series.values.shape[1]):
        values = series.values[:, column]
        distance = np.abs(values - median_filter(values, MEDIAN_ROWS, mode="nearest"))
        low, high = np.percentile(values, (1, 99))
        far = distance > max(sigma * 1.4826 * float(np.median(distance)), float(high - low))
        if far.any():
            found.append((column, int(far.sum()), int(np.argmax(far))))
    return found


def find_marks(values: Floats) -> dict[float, int]:
    """Return the ends of the values (n,) that look like a mark, such as -9999, and their counts.

    A mark stands twice at least, and farther from the other values than these are from each other.
    """
    marks = {}
    for mark in (values.min(), values.max()):
        others = values[values != mark]
        count = len(values) - len(others)
        if count > 1 and others.size and np.abs(others - mark).min() > np.ptp(others) > 0:
            marks[float(mark)] = count
    return marks


def is_oversampled(rate_hz: float) -> bool:
    """Return whether rows come faster than the samples of a session."""
    return rate_hz > FAST_SHARE * SAMPLE_RATE_HZ


def resample(
    series: TimeSeries, max_gap_s: float, low_pass_hz: float = 0.0
) -> tuple[ResampledSeries, list[tuple[float, float]]]:
    """Return the series on a grid of 1 ms, and its gaps as (start, end) in seconds.

    ``low_pass_hz``: cutoff of the filter for rows faster than 1 kHz, 0 for none.
    """
    limit_s = max_gap_s or GAP_PERIODS * series.period_s
    step = 1.0 / SAMPLE_RATE_HZ
    count = int(np.floor(series.time_s[-1] * SAMPLE_RATE_HZ + 1e-6)) + 1
    index = np.arange(count, dtype=np.int64)
    grid = index / SAMPLE_RATE_HZ
    breaks = np.flatnonzero(np.diff(series.time_s) > max(limit_s, 1.5 * step))
    gaps = [(float(series.time_s[k]), float(series.time_s[k + 1])) for k in breaks]
    if low_pass_hz and is_oversampled(series.rate_hz):
        series = _low_pass(series, breaks + 1, low_pass_hz)
    inside = np.ones(count, np.bool_)
    for start, end in gaps:
        inside &= (grid <= start + 1e-9) | (grid >= end - 1e-9)
    grid, index = grid[inside], index[inside]
    columns = [np.interp(grid, series.time_s, column) for column in series.values.T]
    return ResampledSeries(index, np.stack(columns, axis=1), count), gaps


def _low_pass(series: TimeSeries, breaks: NDArray[np.int64], low_pass_hz: float) -> TimeSeries:
    """Filter each stretch between gaps by a Butterworth low-pass, forward and backward: no delay.

    A stretch is interpolated to even steps first. Columns with NaN stay as they are.
    """
    from scipy.signal import butter, sosfiltfilt

    rate_hz = series.rate_hz
    sections = butter(FILTER_ORDER, low_pass_hz, fs=rate_hz, output="sos")
    values = series.values.copy()
    complete = np.flatnonzero(np.isfinite(values).all(axis=0))
    for rows in np.split(np.arange(len(values)), breaks):
        time_s = series.time_s[rows]
        n = max(MIN_ROWS, round(float(time_s[-1] - time_s[0]) * rate_hz) + 1)
        even_s = np.linspace(time_s[0], time_s[-1], n)
        for column in complete:
            even = np.interp(even_s, time_s, values[rows, column])
            smooth = sosfiltfilt(sections, even, padlen=min(PAD_ROWS, n - 1))
            values[rows, column] = np.interp(time_s, even_s, smooth)
    return TimeSeries(series.time_s, values)
