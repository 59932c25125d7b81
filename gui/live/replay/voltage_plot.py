"""The membrane voltage of a neuron of each channel over the time axis of the other plots."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF

from gui.live.live_plots import gap_px, right_column_px
from gui.live.review.overlay import Overlay
from gui.widgets.plots.plot_axes import colour_axes, label_axis, time_plot
from gui.widgets.plots.plot_grid import PlotGrid
from gui.widgets.theme import Theme, scaled_px
from rigctl.values import SAMPLE_RATE_HZ

LOW_MV, HIGH_MV = -90.0, 40.0
HEIGHT_PX = 102
_MARGIN_PX, _TOP_PX = 9, 8
_TICKS = [(-70.0, "−70"), (30.0, "30")]


class VoltagePlot(PlotGrid):
    """v(t) of SA and RA of one taxel, as in the paper's Figure 2D, below plots with the times."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        names = ("SA", "RA")
        self.plots = [
            time_plot(self.cells, row, f"{name}<br>(mV)", last=False)
            for row, name in enumerate(names)
        ]
        self.curves = [pg.PlotCurveItem(skipFiniteCheck=True) for _ in names]
        self.overlays = [Overlay(theme, names_marks=False) for _ in names]
        for plot, curve, overlay in zip(self.plots, self.curves, self.overlays, strict=True):
            plot.setYRange(LOW_MV, HIGH_MV, padding=0)
            plot.getAxis("left").setTicks([_TICKS, []])
            plot.getAxis("bottom").setTicks([[], []])
            plot.addItem(curve)
            plot.addItem(overlay, ignoreBounds=True)
        self.plots[1].setXLink(self.plots[0])
        self._voltage: NDArray[np.float64] = np.zeros((0, 2))
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme and the size of the texts."""
        self._theme = theme
        self.setFixedHeight(scaled_px(HEIGHT_PX))
        right_px = _MARGIN_PX + gap_px() + right_column_px()  # times stand below each other
        self.cells.layout.setContentsMargins(_MARGIN_PX, scaled_px(_TOP_PX), right_px, 0)
        self.colour_background(theme)
        for plot, curve, colour, overlay in zip(
            self.plots, self.curves, theme.groups[:2], self.overlays, strict=True
        ):
            colour_axes(plot, theme)
            curve.setPen(pg.mkPen(colour, width=1))
            overlay.set_theme(theme)

    def show_voltage(self, taxel: int, voltage_mv: NDArray[np.float64]) -> None:
        """Show (n, 2) voltages of a taxel, from 0."""
        self._voltage = voltage_mv
        for plot, name in zip(self.plots, ("SA", "RA"), strict=True):
            label_axis(plot, "left", f"{name}-{taxel + 1}<br>(mV)", self._theme)

    def show_window(self, left_s: float, right_s: float) -> None:
        """Show a part of the time axis, up to its right end."""
        first = max(0, round(left_s * SAMPLE_RATE_HZ))
        end = max(first, round(right_s * SAMPLE_RATE_HZ) + 1)
        shown = self._voltage[first:end]
        time_s = (first + np.arange(len(shown))) / SAMPLE_RATE_HZ
        for channel, curve in enumerate(self.curves):
            curve.setData(time_s, np.ascontiguousarray(shown[:, channel]))
        self.plots[0].setXRange(left_s, right_s, padding=0)
        for plot, overlay in zip(self.plots, self.overlays, strict=True):
            overlay.set_rect(QRectF(plot.getViewBox().viewRect()))
