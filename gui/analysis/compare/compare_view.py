"""A grid of conditions: the raster of their trials above the mean rate and its spread."""

from __future__ import annotations

from math import ceil

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QWidget

from gui.analysis.compare.responses import NeuronResponse, ResponseGrid
from gui.analysis.export.value_file import data_words
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, vbox
from gui.widgets.plot_axes import (
    colour_axes,
    fixed_plot,
    reserve,
    reserve_right,
    title_plot,
)
from gui.widgets.theme import Theme, scaled_px, text_scale

HINT = "Choose a neuron; Compare shows the selected trials, or all that the filter lets through."
COLUMNS, LEFT_PX = 3, 44
LEAST_PX = 185, 240
"""Width and height of a raster with its rates."""
MOST_TICKS = 4


class CompareView(QWidget):
    """Responses of one neuron by plate, speed and force."""

    compare_requested = Signal(int, str)
    """The neuron's train (T_SA-1 … n, then T_RA-1 … n) and its name."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.grid: ResponseGrid | None = None
        self.neuron = QComboBox()
        self.button = push_button("Compare", self._compare)
        self.note = label(HINT, "muted", wraps=True)
        self.plots = pg.GraphicsLayoutWidget()
        self.rasters: list[pg.PlotItem] = []
        self.rates: list[pg.PlotItem] = []
        head = hbox(self.neuron, self.button, self.note, wide=2, margins=(8, 6, 8, 4))
        column = vbox(head, self.plots)
        column.setStretch(1, 1)
        self.setLayout(column)
        self.show_taxels(0)
        self.set_theme(theme)

    def show_taxels(self, n_taxels: int) -> None:
        """Offer the neurons of a sensor."""
        if self.neuron.count() != 2 * n_taxels:
            self.neuron.clear()
            names = [f"T_{k}-{i + 1}" for k in ("SA", "RA") for i in range(n_taxels)]
            self.neuron.addItems(names)
        self.button.setEnabled(n_taxels > 0)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.plots.setBackground(theme.panel)
        reserve_right(self.plots.ci)
        self.show_grid(self.grid)

    def show_grid(self, grid: ResponseGrid | None) -> None:
        """Show conditions, or a hint without any."""
        self.grid = grid
        self.plots.clear()
        self.rasters, self.rates = [], []
        if grid is None or not grid.conditions:
            self.note.setText(HINT if grid is None else "No trial with samples is selected.")
            return
        dashes = "Line: mean of the trials; dashes: mean ± standard deviation."
        origin = f"{data_words(simulated=True)}. " if grid.simulated else ""
        self.note.setText(f"{origin}{grid.neuron}. {dashes} {grid.left_out}")
        top = max(float((c.mean_hz + c.sd_hz).max(initial=1.0)) for c in grid.conditions)
        columns = min(max(1, int(COLUMNS / text_scale())), len(grid.conditions))
        for number, condition in enumerate(grid.conditions):
            self._add(*divmod(number, columns), condition, top)
        rows = ceil(len(grid.conditions) / columns)
        self.plots.setMinimumSize(*(map(scaled_px, (columns * LEAST_PX[0], rows * LEAST_PX[1]))))

    def _compare(self) -> None:
        self.compare_requested.emit(self.neuron.currentIndex(), self.neuron.currentText())

    def _add(self, row: int, column: int, condition: NeuronResponse, top_hz: float) -> None:
        raster = fixed_plot(self.plots.ci, 2 * row, column)
        rate = fixed_plot(self.plots.ci, 2 * row + 1, column)
        title_plot(raster, condition.name, self._theme.text)
        raster.getAxis("bottom").setStyle(showValues=False)
        rate.setLabel("bottom", "Time (s)")
        end_s = float(condition.at_s[-1] + condition.at_s[0]) if len(condition.at_s) else 1.0
        for plot, name in ((raster, "Trial"), (rate, "Rate (Hz)")):
            plot.setLabel("left", name)
            reserve(plot, "left", LEFT_PX)
            plot.setXRange(0, end_s, padding=0)
            colour_axes(plot, self._theme)
        n_trials = len(condition.spikes_s)
        raster.setYRange(0, n_trials, padding=0)
        raster.getAxis("left").setTicks([trial_ticks(n_trials)])
        rate.setYRange(0, 1.05 * top_hz, padding=0)
        self._draw(raster, rate, condition)
        self.rasters.append(raster)
        self.rates.append(rate)

    def _draw(self, raster: pg.PlotItem, rate: pg.PlotItem, condition: NeuronResponse) -> None:
        pen = pg.mkPen(self._theme.groups[0], width=1)
        times = np.concatenate([*condition.spikes_s, np.empty(0)])
        trial = np.repeat(np.arange(len(condition.spikes_s)), list(map(len, condition.spikes_s)))
        x, y = np.repeat(times, 2), (trial[:, None] + np.array([0.1, 0.9])).ravel()
        raster.addItem(pg.PlotCurveItem(x, y, connect="pairs", pen=pen))
        dashes = pg.mkPen(self._theme.muted, width=1, dash=[4, 3])
        for sign in (-1, 1):
            band = np.maximum(condition.mean_hz + sign * condition.sd_hz, 0.0)
            rate.addItem(pg.PlotCurveItem(condition.at_s, band, pen=dashes))
        rate.addItem(pg.PlotCurveItem(condition.at_s, condition.mean_hz, pen=pen))


def trial_ticks(n_trials: int) -> list[tuple[float, str]]:
    """Return places and numbers of at most four trials: each stands in the middle of its row."""
    step = max(1, -(-n_trials // MOST_TICKS))
    return [(index + 0.5, str(index + 1)) for index in range(0, n_trials, step)]
