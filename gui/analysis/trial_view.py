"""One recorded trial: the trace of each taxel and all spike trains over one time axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray

from gui.analysis.tasks.task_values import TrialData
from gui.live.spikes.train_rows import TrainRows
from gui.widgets.plots.plot_axes import (
    colour_axes,
    reserve_right,
    taxel_ticks,
    time_plot,
)
from gui.widgets.plots.plot_grid import PlotGrid
from gui.widgets.theme import Theme
from rigctl.session.format.metadata.sensor_layout import SensorLayout
from rigctl.values import N_TAXELS, SAMPLE_RATE_HZ

NO_TRIAL = "Open a session and choose a trial on the left"
LEAST_PX = (300, 130, 130)
"""Width and heights of two plots whose labels and numbers can be read."""


class TrialView(PlotGrid):
    """Traces and spikes of a trial; drag moves and the wheel zooms both in time."""

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
        heading = data.heading if data is not None else NO_TRIAL
        self.show_heading(self.samples_plot, heading, self._theme)
        rows = TrainRows(data.layout if data is not None else SensorLayout.default(N_TAXELS))
        self._label(rows)
        if data is None or not len(data.samples):
            return
        self._draw_samples(data.samples, rows)
        self._draw_spikes(data, rows)
        self.samples_plot.setXRange(0, len(data.samples) / SAMPLE_RATE_HZ, padding=0)

    def _label(self, rows: TrainRows) -> None:
        ticks = taxel_ticks(rows.sensor_layout.n_taxels), rows.group_ticks()
        plots = self.samples_plot, self.spikes_plot
        for plot, height, names in zip(
            plots, (rows.sensor_layout.n_taxels, len(rows)), ticks, strict=True
        ):
            plot.setYRange(-height, 0, padding=0)
            plot.getAxis("left").setTicks([[(-y, name) for y, name in names], []])

    def _draw_samples(self, samples: NDArray[np.uint16], rows: TrainRows) -> None:
        low = samples.min(axis=0).astype(float)
        span = np.maximum(samples.max(axis=0) - low, 1.0)
        time_s = np.arange(len(samples)) / SAMPLE_RATE_HZ
        for layer, colour in enumerate(rows.layer_colours(self._theme)):
            taxels = np.array(rows.sensor_layout.taxels_of(layer))
            share = (samples[:, taxels] - low[taxels]) / span[taxels]
            y = (0.85 * share - 0.92 - taxels).T
            connect = np.ones(y.shape, np.int32)
            connect[:, -1] = 0
            x = np.tile(time_s, len(taxels))
            _draw_curve(self.samples_plot, x, y.ravel(), connect.ravel(), colour)

    def _draw_spikes(self, data: TrialData, rows: TrainRows) -> None:
        shown_row = np.argsort(rows.order)[data.spike_row]
        time_s = data.spike_sample / SAMPLE_RATE_HZ
        ends = np.array([0.1, 0.9])
        for group, colour in enumerate(rows.group_colours(self._theme)):
            in_group = rows.group_of[shown_row] == group
            x = np.repeat(time_s[in_group], 2)
            y = (-shown_row[in_group, None] - ends).ravel()
            _draw_curve(self.spikes_plot, x, y, "pairs", colour)


def _draw_curve(plot: pg.PlotItem, x: Any, y: Any, connect: Any, colour: str) -> None:
    pen = pg.mkPen(colour, width=1)
    plot.addItem(pg.PlotCurveItem(x, y, connect=connect, pen=pen, skipFiniteCheck=True))
