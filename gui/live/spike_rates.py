"""Spike rates of the last second: one bar per raster row, beside it."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QGraphicsItem

from gui.live.live_data import LiveData
from gui.live.raster import TrainRows
from gui.widgets.plot_axes import label_axis
from gui.widgets.theme import Theme
from rigctl.session.sensor_layout import SensorLayout
from rigctl.values import SAMPLE_RATE_HZ

FULL_SCALE_HZ = 300.0
RATE_TICKS_HZ = (0, 100, 200)
FULL_SCALE_A_MM = 6.0
RATE_TICKS_A_MM = (0, 2, 4)
LEAST_TRAVEL_MM = 1.0
"""With less in the window, spikes per mm would be a division by nearly nothing: no bars."""
WINDOW_S = 1.0


class RateBars(QGraphicsItem):
    """Horizontal bars from 0 to the rate, in the raster's row order.

    ``rates_hz``: spikes a second, (n_rows,). ``rates_a_mm``: spikes a mm of texture where these
    are shown, else None. ``is_per_mm``: whether they are to be shown.
    """

    def __init__(self, theme: Theme, layout: SensorLayout) -> None:
        super().__init__()
        self.theme = theme
        self.rows = TrainRows(layout)
        self.rates_hz = np.zeros(len(self.rows))
        self.rates_a_mm: NDArray[np.float64] | None = None
        self.is_per_mm = False

    def set_sensor_layout(self, layout: SensorLayout) -> None:
        """Order the bars by the layers of another sensor with as many taxels."""
        self.show_rows(TrainRows(layout))

    def show_rows(self, rows: TrainRows) -> None:
        """Show other rows of the trains."""
        self.prepareGeometryChange()
        self.rows = rows
        self.rates_hz, self.rates_a_mm = np.zeros(len(rows)), None

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.theme = theme
        self.update()

    def refresh_at(self, data: LiveData, position: int) -> None:
        """Show the rates of the second up to a position."""
        n = round(WINDOW_S * SAMPLE_RATE_HZ)
        travelled_mm = data.drum.travelled_mm(position, n) if self.is_per_mm else None
        self.refresh(data.spikes_before(position, n), travelled_mm)

    def refresh(self, spikes: NDArray[np.uint8], travelled_mm: float | None = None) -> None:
        """Show the rates of the newest second of spikes, uint8 (n, n_rows), encoder's order.

        ``travelled_mm``: show spikes per mm of this texture instead of per second.
        """
        newest = spikes[-round(WINDOW_S * SAMPLE_RATE_HZ) :]
        seconds = max(len(newest), 1) / SAMPLE_RATE_HZ
        counts = newest.sum(axis=0, dtype=np.int64)[self.rows.order]
        self.rates_hz, self.rates_a_mm = counts / seconds, None
        if travelled_mm is not None:
            has_moved = travelled_mm >= LEAST_TRAVEL_MM
            self.rates_a_mm = counts / travelled_mm if has_moved else np.zeros(len(counts))
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of all rows up to the full scale."""
        return QRectF(0.0, 0.0, FULL_SCALE_HZ, float(len(self.rows)))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw one rectangle per row."""
        colours = [QColor(colour) for colour in self.rows.group_colours(self.theme)]
        shown = self.rates_hz
        if self.rates_a_mm is not None:
            shown = self.rates_a_mm * (FULL_SCALE_HZ / FULL_SCALE_A_MM)
        for row, rate in enumerate(np.minimum(shown, FULL_SCALE_HZ)):
            colour = colours[self.rows.group_of[row]]
            painter.fillRect(QRectF(0.0, row + 0.12, float(rate), 0.76), colour)


A_SECOND = "Rate in the last second (Hz)"
A_MM = "Rate in the last second (1/mm)"


def label_rates(plot: pg.PlotItem, theme: Theme, is_per_mm: bool) -> None:
    """Write the numbers and the unit of the rates below a plot whose width is the full scale."""
    ticks = [(float(hz), f"{hz}") for hz in RATE_TICKS_HZ]
    if is_per_mm:
        ticks = [(n * FULL_SCALE_HZ / FULL_SCALE_A_MM, f"{n}") for n in RATE_TICKS_A_MM]
    plot.getAxis("bottom").setTicks([ticks, []])
    label_axis(plot, "bottom", A_MM if is_per_mm else A_SECOND, theme)
