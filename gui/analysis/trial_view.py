"""One recorded trial: the trace of each taxel and all spike trains over one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt, Signal

from gui.analysis.task_values import Section, TrialData
from gui.live.raster import TrainRows
from gui.widgets.labels import plain_tooltip
from gui.widgets.plot_axes import Plot, PlotGrid, reserve_right, taxel_ticks, time_plot
from gui.widgets.theme import Theme
from rigctl.session.sensor_layout import PAPER_SENSOR
from rigctl.values import SAMPLE_RATE_HZ, TrialMark

NO_TRIAL = "Open a session and choose a trial on the left"
LEAST_PX = (300, 130, 130)
"""Width and heights of two plots whose labels and numbers can be read."""


MARK_LETTERS = 40


def add_marks(plots: Sequence[Plot], marks: Sequence[TrialMark], theme: Theme) -> None:
    """Draw a line at each note, with its text in the first plot."""
    pen = pg.mkPen(theme.muted, width=1, style=Qt.PenStyle.DotLine)
    for at_s, text in marks:
        short = text if len(text) <= MARK_LETTERS else f"{text[: MARK_LETTERS - 1]}…"
        for number, plot in enumerate(plots):
            line = pg.InfiniteLine(at_s, angle=90, pen=pen)
            line.setToolTip(plain_tooltip(text))
            if number == 0:
                opts = {"position": 0.06, "color": theme.text, "fill": theme.plot}
                pg.InfLineLabel(line, short, anchors=[(0, 0), (0, 0)], **opts)
            plot.addItem(line)


class TrialView(PlotGrid):
    """Traces and spikes of a trial; drag moves and the wheel zooms both in time.

    Only what is in view is drawn, and of many samples the extremes at each pixel: a path through
    all samples of ten minutes takes seconds at each painting, and STOP would wait.
    """

    section_requested = Signal(int, int, int)
    """First sample, end and samples a pixel of a part of a long trial to show by show_section."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.data: TrialData | None = None
        self._section: Section | None = None
        self.samples_plot = time_plot(self.cells, 0, "Taxels<br>(own range)", last=False)
        self.spikes_plot = time_plot(self.cells, 1, "Spikes", last=True)
        self.spikes_plot.setLabel("bottom", "Time in the trial (s)")
        self.spikes_plot.setXLink(self.samples_plot)
        for plot in (self.samples_plot, self.spikes_plot):
            plot.setMouseEnabled(x=True, y=False)
        self._curves: list[pg.PlotCurveItem] = []
        view = self.samples_plot.getViewBox()
        for changed in (view.sigXRangeChanged, view.sigResized):
            changed.connect(lambda *_: self._draw())
        self.set_theme(theme)
        self.show_trial(None)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme, self.samples_plot, self.spikes_plot)
        self.reserve_plots(*LEAST_PX)
        reserve_right(self.cells)
        self.show_trial(self.data)

    def show_trial(self, data: TrialData | None) -> None:
        """Show a trial, or a hint without one."""
        self.data, self._section = data, None
        for plot in (self.samples_plot, self.spikes_plot):
            plot.clear()
        self._curves = []
        heading = data.heading if data is not None else NO_TRIAL
        self.show_heading(self.samples_plot, heading, self._theme)
        rows = TrainRows(data.layout if data is not None else PAPER_SENSOR)
        self._label(rows)
        if data is None or not data.n_samples:
            return
        self._rows = rows
        self.samples_plot.setXRange(0, data.n_samples / SAMPLE_RATE_HZ, padding=0)
        self._low = data.overview.low.min(axis=0).astype(float)
        self._span = np.maximum(data.overview.high.max(axis=0) - self._low, 1.0)
        layers, groups = rows.layer_colours(self._theme), rows.group_colours(self._theme)
        for plot, colours in ((self.samples_plot, layers), (self.spikes_plot, groups)):
            for colour in colours:
                curve = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1), skipFiniteCheck=True)
                plot.addItem(curve)
                self._curves.append(curve)
        add_marks((self.samples_plot, self.spikes_plot), data.marks, self._theme)
        self._draw()

    def show_section(self, section: Section) -> None:
        """Show a part of the trial as finely as it was requested."""
        self._section = section
        self._draw()

    def _draw(self) -> None:
        """Draw what is in view, in the width that it has, and request what is not there so fine."""
        if self.data is None or not self._curves:
            return
        n = self.data.n_samples
        left_s, right_s = self.samples_plot.getViewBox().viewRange()[0]
        first = min(max(0, int(left_s * SAMPLE_RATE_HZ) - 1), n - 1)
        end = min(max(first + 1, int(right_s * SAMPLE_RATE_HZ) + 2), n)
        factor = max(1, ceil((end - first) / max(1.0, self.samples_plot.getViewBox().width())))
        n_layers = len(self._rows.layer_colours(self._theme))
        shown = finest(self.data.overview, self._section, first, min(end, n))
        self._draw_samples(shown, first, end, factor, self._curves[:n_layers])
        self._draw_spikes(shown, first, end, factor, self._curves[n_layers:])
        if shown.factor > factor:
            self.section_requested.emit(*wider(first, end, n), factor)

    def _label(self, rows: TrainRows) -> None:
        ticks = taxel_ticks(rows.sensor_layout.n_taxels), rows.group_ticks()
        plots = self.samples_plot, self.spikes_plot
        for plot, height, names in zip(
            plots, (rows.sensor_layout.n_taxels, len(rows)), ticks, strict=True
        ):
            plot.setYRange(-height, 0, padding=0)
            plot.getAxis("left").setTicks([[(-y, name) for y, name in names], []])

    def _draw_samples(
        self, section: Section, first: int, end: int, factor: int, curves: list[pg.PlotCurveItem]
    ) -> None:
        at, readings = extremes(section, first, end, factor)
        share = (readings - self._low) / self._span
        for layer, curve in enumerate(curves):
            taxels = np.array(self._rows.sensor_layout.taxels_of(layer))
            y = (0.85 * share[:, taxels] - 0.92 - taxels).T
            connect = np.ones(y.shape, np.int32)
            connect[:, -1] = 0
            x = np.tile(at / SAMPLE_RATE_HZ, len(taxels))
            curve.setData(x, y.ravel(), connect=connect.ravel(), skipFiniteCheck=True)

    def _draw_spikes(
        self, section: Section, first: int, end: int, factor: int, curves: list[pg.PlotCurveItem]
    ) -> None:
        """Draw a line for each spike, one for all of a row that stand at the same place."""
        starts, stop = _groups(section, first, end, factor)
        places = np.maximum.reduceat(section.spikes[:stop], starts, axis=0)[:, self._rows.order]
        column, row = np.nonzero(places)
        time_s = (section.first + starts[column] * section.factor) / SAMPLE_RATE_HZ
        for group, curve in enumerate(curves):
            in_group = self._rows.group_of[row] == group
            x = np.repeat(time_s[in_group], 2)
            y = (-row[in_group, None] - np.array([0.1, 0.9])).ravel()
            curve.setData(x, y, connect="pairs", skipFiniteCheck=True)


def finest(overview: Section, section: Section | None, first: int, end: int) -> Section:
    """Return the section if it has these samples of the trial, else the overview."""
    has_all = section is not None and section.first <= first and section.end >= end
    return section if section is not None and has_all else overview


def wider(first: int, end: int, n_samples: int) -> tuple[int, int]:
    """Return a part of a trial with as much again on both sides, so that a drag shows it."""
    return max(0, 2 * first - end), min(2 * end - first, n_samples)


def _groups(section: Section, first: int, end: int, factor: int) -> tuple[NDArray[np.int64], int]:
    """Return the first group of a section at each place of ``factor`` samples, and the end."""
    begin, stop = (
        (first - section.first) // section.factor,
        -(-(end - section.first) // section.factor),
    )
    return np.arange(begin, stop, max(1, factor // section.factor)), stop


def extremes(
    section: Section, first: int, end: int, factor: int
) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
    """Return the samples from ``first`` to before ``end``: at which, (k,), readings, (k, n_taxels).

    Where ``factor`` is 2 or more, each place of so many samples has two: its lowest and highest
    reading of each taxel.
    """
    starts, stop = _groups(section, first, end, factor)
    at = section.first + starts * section.factor
    if factor < 2 and section.factor == 1:
        return at, section.low[starts]
    lowest = np.minimum.reduceat(section.low[:stop], starts, axis=0)
    highest = np.maximum.reduceat(section.high[:stop], starts, axis=0)
    both = np.stack([lowest, highest], axis=1)
    return np.repeat(at, 2), both.reshape(-1, both.shape[2])
