"""One recorded trial: the trace of each taxel and all spike trains over one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt

from gui.analysis.task_values import BLOCK, TrialData
from gui.live.raster import TrainRows
from gui.widgets.labels import plain_tooltip
from gui.widgets.plot_axes import (
    PlotGrid,
    colour_axes,
    reserve_right,
    taxel_ticks,
    time_plot,
)
from gui.widgets.theme import Theme
from rigctl.session.sensor_layout import PAPER_SENSOR
from rigctl.values import SAMPLE_RATE_HZ, TrialMark

NO_TRIAL = "Open a session and choose a trial on the left"
LEAST_PX = (300, 130, 130)
"""Width and heights of two plots whose labels and numbers can be read."""


MARK_LETTERS = 40


def add_marks(plots: Sequence[pg.PlotItem], marks: Sequence[TrialMark], theme: Theme) -> None:
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

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.data: TrialData | None = None
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
        self.colour_background(theme)
        for plot in (self.samples_plot, self.spikes_plot):
            colour_axes(plot, theme)
        self.reserve_plots(*LEAST_PX)
        reserve_right(self.cells)
        self.show_trial(self.data)

    def show_trial(self, data: TrialData | None) -> None:
        """Show a trial, or a hint without one."""
        self.data = data
        for plot in (self.samples_plot, self.spikes_plot):
            plot.clear()
        self._curves = []
        heading = data.heading if data is not None else NO_TRIAL
        self.show_heading(self.samples_plot, heading, self._theme)
        rows = TrainRows(data.layout if data is not None else PAPER_SENSOR)
        self._label(rows)
        if data is None or not len(data.samples):
            return
        self._rows = rows
        self.samples_plot.setXRange(0, len(data.samples) / SAMPLE_RATE_HZ, padding=0)
        whole = data.samples if data.blocks is None else np.concatenate(list(data.blocks))
        self._low = whole.min(axis=0).astype(float)
        self._span = np.maximum(whole.max(axis=0) - self._low, 1.0)
        layers, groups = rows.layer_colours(self._theme), rows.group_colours(self._theme)
        for plot, colours in ((self.samples_plot, layers), (self.spikes_plot, groups)):
            for colour in colours:
                curve = pg.PlotCurveItem(pen=pg.mkPen(colour, width=1), skipFiniteCheck=True)
                plot.addItem(curve)
                self._curves.append(curve)
        add_marks((self.samples_plot, self.spikes_plot), data.marks, self._theme)
        self._draw()

    def _draw(self) -> None:
        """Draw what is in view, in the width that it has."""
        if self.data is None or not self._curves:
            return
        n = len(self.data.samples)
        left_s, right_s = self.samples_plot.getViewBox().viewRange()[0]
        first = min(max(0, int(left_s * SAMPLE_RATE_HZ) - 1), n - 1)
        end = min(max(first + 1, int(right_s * SAMPLE_RATE_HZ) + 2), n)
        factor = max(1, ceil((end - first) / max(1.0, self.samples_plot.getViewBox().width())))
        n_layers = len(self._rows.layer_colours(self._theme))
        self._draw_samples(first, end, factor, self._curves[:n_layers])
        self._draw_spikes(first, end, factor, self._curves[n_layers:])

    def _label(self, rows: TrainRows) -> None:
        ticks = taxel_ticks(rows.sensor_layout.n_taxels), rows.group_ticks()
        plots = self.samples_plot, self.spikes_plot
        for plot, height, names in zip(
            plots, (rows.sensor_layout.n_taxels, len(rows)), ticks, strict=True
        ):
            plot.setYRange(-height, 0, padding=0)
            plot.getAxis("left").setTicks([[(-y, name) for y, name in names], []])

    def _draw_samples(
        self, first: int, end: int, factor: int, curves: list[pg.PlotCurveItem]
    ) -> None:
        assert self.data is not None
        at, readings = extremes(self.data, first, end, factor)
        share = (readings - self._low) / self._span
        for layer, curve in enumerate(curves):
            taxels = np.array(self._rows.sensor_layout.taxels_of(layer))
            y = (0.85 * share[:, taxels] - 0.92 - taxels).T
            connect = np.ones(y.shape, np.int32)
            connect[:, -1] = 0
            x = np.tile(at / SAMPLE_RATE_HZ, len(taxels))
            curve.setData(x, y.ravel(), connect=connect.ravel(), skipFiniteCheck=True)

    def _draw_spikes(
        self, first: int, end: int, factor: int, curves: list[pg.PlotCurveItem]
    ) -> None:
        """Draw a line for each spike, one for all of a row that stand at the same place."""
        assert self.data is not None
        shown_row = np.argsort(self._rows.order)
        is_in_view = (self.data.spike_sample >= first) & (self.data.spike_sample < end)
        places = np.zeros((len(self._rows), -(-(end - first) // factor)), bool)
        column = (self.data.spike_sample[is_in_view] - first) // factor
        places[shown_row[self.data.spike_row[is_in_view]], column] = True
        row, column = np.nonzero(places)
        time_s, ends = (first + column * factor) / SAMPLE_RATE_HZ, np.array([0.1, 0.9])
        for group, curve in enumerate(curves):
            in_group = self._rows.group_of[row] == group
            x = np.repeat(time_s[in_group], 2)
            y = (-row[in_group, None] - ends).ravel()
            curve.setData(x, y, connect="pairs", skipFiniteCheck=True)


def extremes(
    data: TrialData, first: int, end: int, factor: int
) -> tuple[NDArray[np.int64], NDArray[np.uint16]]:
    """Return the samples from ``first`` to before ``end``: at which, (k,), readings, (k, n_taxels).

    Where ``factor`` is 2 or more, each place of so many samples has two: its lowest and highest
    reading of each taxel.
    """
    if factor < 2:
        return np.arange(first, end), data.samples[first:end]
    low, high, scale = data.samples, data.samples, 1
    if data.blocks is not None and factor >= BLOCK:
        (low, high), scale = data.blocks, BLOCK
        first, end, factor = first // BLOCK, end // BLOCK, factor // BLOCK
    starts = np.arange(first, end, factor)
    lowest = np.minimum.reduceat(low[:end], starts, axis=0)
    highest = np.maximum.reduceat(high[:end], starts, axis=0)
    both = np.stack([lowest, highest], axis=1)
    return np.repeat(starts * scale, 2), both.reshape(-1, low.shape[1])
