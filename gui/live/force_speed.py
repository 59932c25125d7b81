"""Plots of the drum's force and speed over time, each with its set-point."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsItem

from gui.live.history import SPAN_S
from gui.widgets.theme import Theme

_HEADROOM = 1.1
_ROUND_TOPS = (50, 100, 150, 200, 300, 400, 600, 800, 1200, 1600, 2000, 3000)


class PlotLine(QGraphicsItem):
    """A polyline with a fixed bounding rectangle, so that new points cost only their drawing."""

    def __init__(self) -> None:
        super().__init__()
        self._points = QPolygonF()
        self._pen = QPen()
        self._top = 1.0

    def set_pen(self, colour: str) -> None:
        """Set the colour of the line."""
        self._pen = pg.mkPen(colour, width=1)
        self.update()

    def set_top(self, top: float) -> None:
        """Set the upper end of the bounding rectangle; it begins a little below 0."""
        self.prepareGeometryChange()
        self._top = top

    def set_points(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Set the points, (n,) each."""
        self._points = pg.functions.arrayToQPolygonF(x, y) if len(x) else QPolygonF()
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the whole plot."""
        return QRectF(-float(SPAN_S), -0.1 * self._top, float(SPAN_S), 1.2 * self._top)

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the line; a polyline with a thin pen costs a fifth of a path."""
        painter.setPen(self._pen)
        painter.drawPolyline(self._points)


class SetPointPlot:
    """A measured quantity over its set-point; the scale changes in round steps only."""

    def __init__(self, plot: pg.PlotItem, colour: str, theme: Theme) -> None:
        self._plot = plot
        self._colour = colour
        self._set_point, self._measured = PlotLine(), PlotLine()
        for line in (self._set_point, self._measured):
            plot.addItem(line)
        self._top = 0.0
        self._set_scale(0.0)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._set_point.set_pen(theme.set_point)
        self._measured.set_pen(getattr(theme, self._colour))

    def refresh(
        self,
        time_s: NDArray[np.float64],
        measured: NDArray[np.float64],
        set_point: NDArray[np.float64],
    ) -> None:
        """Show (n,) values at times relative to now, ``time_s`` (negative, newest last)."""
        self._measured.set_points(time_s, measured)
        self._set_point.set_points(time_s, set_point)
        if len(time_s):
            self._set_scale(float(max(measured.max(), set_point.max())))

    def _set_scale(self, highest: float) -> None:
        least = highest * _HEADROOM
        top = float(next((top for top in _ROUND_TOPS if top >= least), least))
        if top == self._top:
            return
        self._top = top
        self._plot.setYRange(-0.04 * top, 1.04 * top, padding=0)
        ticks = [(value, f"{value:.0f}") for value in (0.0, top / 2, top)]
        self._plot.getAxis("left").setTicks([ticks, []])
        for line in (self._set_point, self._measured):
            line.set_top(top)
