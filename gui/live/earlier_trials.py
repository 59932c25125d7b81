"""Faint lines of earlier trials behind the present one, and the mean rates of two neurons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gui.live.drum_course import thin_out
from gui.live.live_data import LiveData
from gui.live.raster import FULL_SCALE_HZ
from gui.live.sample_history import SampleHistory, TimeWindow
from gui.live.time_plots import PlotLine, TimePlots
from gui.widgets.plot_axes import Plot
from gui.widgets.theme import Theme
from rigctl.boards.taxel_frames import Flag
from rigctl.engine.rpc.messages import EngineStatus
from rigctl.values import SAMPLE_RATE_HZ

KEPT = 200


class Condition(NamedTuple):
    """What earlier trials must share to be comparable."""

    plate: str
    speed_mm_s: float
    force_g: float

    def __str__(self) -> str:
        return f"plate {self.plate or '?'}, {self.speed_mm_s:g} mm/s, {self.force_g:g} g"


@dataclass(slots=True)
class TrialSpan:
    """A trial's positions ``start`` … ``end``; ``end`` is None while it goes on."""

    start: int
    condition: Condition
    end: int | None = None


def condition_of(status: EngineStatus) -> Condition:
    """Return the condition of the trial that is running, else of the drum's settings."""
    if (current := status.run.current) is not None:
        return Condition(current.texture, current.speed_mm_s, current.force_g)
    return Condition(status.texture or "", status.speed_set_mm_s, status.force_set_g)


class TrialStarts:
    """The newest trials, by the rises and falls of the sync line, as the session cuts them."""

    def __init__(self) -> None:
        self.condition = Condition("", 0.0, 0.0)
        self.clear()

    def clear(self) -> None:
        """Remove all trials."""
        self.trials: list[TrialSpan] = []
        self._row, self._generation, self._is_high = 0, -1, True

    def follow(self, history: SampleHistory) -> None:
        """Find trials in the samples that came since the last call."""
        if history.generation != self._generation:
            self.clear()
            self._generation = history.generation
        first, self._row = max(self._row, history.flags.first), history.flags.end
        high = (history.flags.between(first, self._row) & Flag.SYNC) > 0
        if not len(high):
            return
        changes = np.flatnonzero(np.diff(high, prepend=self._is_high)) + first
        self._is_high = bool(high[-1])
        for row in changes.tolist():
            self._change(int(history.counters.take(np.array([row]))[0]), bool(high[row - first]))

    def newest(self, oldest_position: int) -> TrialSpan | None:
        """Return the newest trial whose beginning is still there."""
        trial = self.trials[-1] if self.trials else None
        return trial if trial is not None and trial.start >= oldest_position else None

    def before(self, trial: TrialSpan, count: int, oldest_position: int) -> list[TrialSpan]:
        """Return at most ``count`` whole trials of its condition before it, the newest last."""
        like = [
            other
            for other in self.trials
            if other.start < trial.start
            and other.condition == trial.condition
            and other.start >= oldest_position
            and other.end is not None
        ]
        return like[-count:] if count else []

    def _change(self, position: int, is_high: bool) -> None:
        if is_high:
            self.trials.append(TrialSpan(position, self.condition))
            del self.trials[:-KEPT]
        elif self.trials:
            self.trials[-1].end = position


MOST = 10
BIN_S = 0.02
_FAINT = "70"  # the last two digits of #rrggbbaa
_ABOVE_IMAGES = 5
Line = tuple[NDArray[np.float64], NDArray[np.float64]]


class EarlierTrials:
    """Lines over the time plots: force, speed, the readings of one taxel, and its rates.

    The rates stand in the taxel's two rows of the raster, a row being 0 … 300 Hz: the mean over
    the earlier trials in bins of 20 ms, as a peri-stimulus time histogram.
    """

    def __init__(self, plots: TimePlots, theme: Theme) -> None:
        self._plots = plots
        self._lines = [[self._line(plot) for _ in range(MOST)] for plot in plots.plots[:3]]
        self._rates = [self._line(plots.plots[3]) for _ in range(2)]
        self._drawn: object = None
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        for line in (line for lines in self._lines for line in lines):
            line.set_pen(theme.muted + _FAINT)
        for line in self._rates:
            line.set_pen(theme.text)

    def clear(self) -> None:
        """Show none."""
        if self._drawn is not None:
            self._drawn = None
            for line in (line for lines in (*self._lines, self._rates) for line in lines):
                line.setVisible(False)

    def show(self, data: LiveData, window: TimeWindow, trials: list[TrialSpan], taxel: int) -> None:
        """Show trials in a window whose time 0 is the beginning of the present one."""
        starts = tuple(trial.start for trial in trials)
        ranges = (*self._plots.traces.range_of(taxel), self._plots.traces.eye)
        wanted = (window, starts, taxel, ranges, self._plots.taxels, self._plots.force.values)
        if wanted == self._drawn:
            return
        self.clear()
        self._drawn = wanted
        for number, trial in enumerate(trials[-MOST:]):
            part = _window_of(trial, window)
            time_s, columns = data.drum.within(part)
            self._set(self._lines[0][number], window, (time_s, columns["force_g"]))
            self._set(self._lines[1][number], window, (time_s, columns["speed_mm_s"]))
            if taxel in self._plots.taxels and self._plots.traces.eye is None:
                self._set(self._lines[2][number], window, self._readings(data, part, taxel))
        if trials and taxel in self._plots.taxels:
            self._show_rates(data, window, trials, taxel)

    def _show_rates(
        self, data: LiveData, window: TimeWindow, trials: list[TrialSpan], taxel: int
    ) -> None:
        n_taxels = len(data.low)
        for line, train in zip(self._rates, (taxel, n_taxels + taxel), strict=True):
            at_s, rate_hz = mean_rate_hz(data, trials, window, train)
            row = int(np.flatnonzero(self._plots.raster.rows.order == train)[0])
            height = np.clip(rate_hz / FULL_SCALE_HZ, 0.0, 1.0)
            self._set(line, window, (at_s, row + 1.0 - height))

    def _readings(self, data: LiveData, part: TimeWindow, taxel: int) -> Line:
        band = self._plots.taxels.index(taxel)
        low, high = self._plots.traces.range_of(taxel)
        positions, rows = _rows(data, part)
        counts = data.history.samples.between(*rows)[:, taxel].astype(np.float64)
        share = np.clip((counts - low) / (high - low), 0.0, 1.0)
        return thin_out((positions - part.origin) / SAMPLE_RATE_HZ, band + 1.0 - share)

    def _set(self, line: PlotLine, window: TimeWindow, points: Line) -> None:
        line.set_times(window.left_s, window.right_s)
        line.set_points(*points)
        line.setVisible(True)

    def _line(self, plot: Plot) -> PlotLine:
        line = PlotLine()
        bottom, top = sorted(plot.getViewBox().viewRange()[1])
        line.set_values(min(bottom, 0.0), max(top, 3000.0))
        line.setZValue(_ABOVE_IMAGES)
        line.setVisible(False)
        plot.addItem(line)
        return line


def mean_rate_hz(data: LiveData, trials: list[TrialSpan], window: TimeWindow, train: int) -> Line:
    """Return steps of the mean spike rate of a train over trials: times in s, and Hz.

    A bin counts the trials that last to its end.
    """
    n_bins = round(window.span / SAMPLE_RATE_HZ / BIN_S)
    spikes, counted = np.zeros(n_bins), np.zeros(n_bins)
    for trial in trials:
        positions, rows = _rows(data, _window_of(trial, window))
        seconds = (positions - trial.start) / SAMPLE_RATE_HZ
        whole = min(n_bins, int(((trial.end or trial.start) - trial.start) / 1000 / BIN_S))
        at = (seconds / BIN_S).astype(np.int64)
        counts = data.history.spikes.between(*rows)[:, train]
        inside = (at >= 0) & (at < whole)
        spikes += np.bincount(at[inside], counts[inside], n_bins)
        counted[:whole] += 1
    kept = counted > 0
    rate_hz = spikes[kept] / counted[kept] / BIN_S
    edges = np.repeat(np.arange(len(rate_hz) + 1) * BIN_S, 2)[1:-1]
    return edges, np.repeat(rate_hz, 2)


def _window_of(trial: TrialSpan, window: TimeWindow) -> TimeWindow:
    """Return the part of a trial that stands in a window, with time 0 at its own beginning."""
    shift = trial.start - window.origin
    right = min(window.right + shift, trial.start if trial.end is None else trial.end)
    left = max(window.left + shift, trial.start)
    return TimeWindow(right, max(right - left, 1), trial.start)


def _rows(data: LiveData, part: TimeWindow) -> tuple[NDArray[np.int64], tuple[int, int]]:
    counters = data.history.counters
    first, end = (int(row) for row in counters.count_below(np.array([part.left, part.right])))
    return counters.between(first, end), (first, end)
