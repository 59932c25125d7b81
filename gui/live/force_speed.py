"""Plots of the drum's force and speed over time, each with its set-point."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QRectF
from PySide6.QtGui import QPainter, QPen, QPolygonF
from PySide6.QtWidgets import QGraphicsItem

from gui.live.history import SPAN_S
from gui.live.store.drum_course import thin_out
from gui.widgets.theme import Theme

_HEADROOM = 1.1
_DASHES = (5, 4)
_MARGIN = 0.04
_ROUND_TOPS = (50, 100, 150, 200, 300, 400, 600, 800, 1200, 1600, 2000, 3000)


class PlotLine(QGraphicsItem):
    """A polyline with a fixed bounding rectangle, so that new points cost only their drawing."""

    def __init__(self) -> None:
        super().__init__()
        self._points = QPolygonF()
        self.pen = QPen()
        self._bottom, self._top = 0.0, 1.0
        self._left_s, self._right_s = -float(SPAN_S), 0.0

    def set_pen(self, colour: str, *, is_dashed: bool = False) -> None:
        """Set the colour of the line."""
        self.pen = pg.mkPen(colour, width=1, dash=_DASHES if is_dashed else None)
        self.update()

    def set_values(self, bottom: float, top: float) -> None:
        """Set the lower and upper ends of the bounding rectangle, which has a small margin."""
        self.prepareGeometryChange()
        self._bottom, self._top = bottom, top

    def set_times(self, left_s: float, right_s: float) -> None:
        """Set the left and right ends of the bounding rectangle."""
        if (left_s, right_s) != (self._left_s, self._right_s):
            self.prepareGeometryChange()
            self._left_s, self._right_s = left_s, right_s

    def set_points(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Set the points, (n,) each."""
        self._points = pg.functions.arrayToQPolygonF(x, y) if len(x) else QPolygonF()
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the whole plot."""
        width, height = self._right_s - self._left_s, self._top - self._bottom
        return QRectF(self._left_s, self._bottom - 0.1 * height, width, 1.2 * height)

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the line; a polyline with a thin pen costs a fifth of a path."""
        painter.setPen(self.pen)
        painter.drawPolyline(self._points)


class SetPointPlot:
    """A measured quantity over its set-point; the scale changes in round steps only."""

    def __init__(self, plot: pg.PlotItem, colour: str, theme: Theme) -> None:
        self._plot = plot
        self._colour = colour
        self._set_point, self._measured = PlotLine(), PlotLine()
        for line in (self._set_point, self._measured):
            plot.addItem(line)
        self.values = (0.0, 0.0)
        """Lowest and highest value on the axis."""
        self._set_scale(0.0, 0.0)
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._set_point.set_pen(theme.set_point, is_dashed=True)
        self._measured.set_pen(getattr(theme, self._colour))

    def set_times(self, left_s: float, right_s: float) -> None:
        """Set the ends of the time axis."""
        for line in (self._set_point, self._measured):
            line.set_times(left_s, right_s)

    def refresh(
        self,
        time_s: NDArray[np.float64],
        measured: NDArray[np.float64],
        set_point: NDArray[np.float64],
    ) -> None:
        """Show (n,) values at times of the axis, ``time_s`` (ascending)."""
        self._measured.set_points(*thin_out(time_s, measured))
        self._set_point.set_points(*corners(time_s, set_point))
        if len(time_s):
            lowest, highest = float(measured.min()), float(max(measured.max(), set_point.max()))
            self._set_scale(lowest, highest)

    def _set_scale(self, lowest: float, highest: float) -> None:
        top = _round_end(highest)
        bottom = 0.0 if lowest >= -_MARGIN * top else -_round_end(-lowest)
        if (bottom, top) == self.values:
            return
        self.values = (bottom, top)
        height = top - bottom
        self._plot.setYRange(bottom - _MARGIN * height, top + _MARGIN * height, padding=0)
        ticks = [(value, f"{value:.0f}".replace("-", "−")) for value in _ticks(bottom, top)]
        self._plot.getAxis("left").setTicks([ticks, []])
        for line in (self._set_point, self._measured):
            line.set_values(bottom, top)


def corners(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ends of each stretch of equal values: dashes of many short lines cost more."""
    if not len(y):
        return x, y
    is_end = np.ones((2, len(y)), bool)  # of a stretch's first and last value
    is_end[0, 1:] = is_end[1, :-1] = y[1:] != y[:-1]
    kept = np.flatnonzero(is_end[0] | is_end[1])
    return thin_out(x[kept], y[kept])


def _round_end(value: float) -> float:
    """Return a round end of an axis that leaves headroom above ``value``."""
    least = value * _HEADROOM
    return float(next((top for top in _ROUND_TOPS if top >= least), least))


def _ticks(bottom: float, top: float) -> tuple[float, ...]:
    """Return 0, the ends and, where nothing is negative, the middle."""
    return (bottom, 0.0, top) if bottom else (0.0, top / 2, top)
