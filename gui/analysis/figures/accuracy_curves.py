"""The curves of a plot of accuracy with their bars and symbols, as one item.

Five items of pyqtgraph for each curve took most of the time of making and painting a plot.
"""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from math import ceil

import numpy as np
import pyqtgraph as pg
from pyqtgraph.graphicsItems.ScatterPlotItem import Symbols
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QBrush, QPainter, QPainterPath, QPen, QTransform
from PySide6.QtWidgets import QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from gui.analysis.figures.curve_looks import PAPER_PX, PAPER_SYMBOL, SYMBOL_PX, look_of
from gui.widgets.theme import Theme
from rigctl.analysis.report.figure import Panel, Series

SYMBOLS = 8
ROOM, MARGIN = 1.04, 0.07
"""Where a plot ends above its largest value, and the share of its width right of the curves."""
_SMOOTH = QPainter.RenderHint.Antialiasing


class AccuracyCurves(QGraphicsItem):
    """Draws curves with bars, a symbol at some of their points, and the paper's values."""

    def __init__(self, panel: Panel, hidden: AbstractSet[str], theme: Theme) -> None:
        super().__init__()
        self._last = last_x(panel)
        self._rect = QRectF(0, 0, (1 + MARGIN) * self._last, ROOM * panel.y_range[1])
        self._lines: list[tuple[QPen, QPainterPath, bool]] = []
        self._symbols: list[tuple[QPen, QBrush, QPainterPath, list[QPointF]]] = []
        for curve in panel.series:
            if curve.name not in hidden:
                self._add_curve(curve, theme)
                self._add_paper(curve, theme)

    def boundingRect(self) -> QRectF:
        """Return the whole plot."""
        return self._rect

    def paint(
        self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None
    ) -> None:
        """Draw the lines, and above them the symbols, which no axis stretches."""
        painter.save()
        for pen, path, is_smooth in self._lines:
            painter.setRenderHint(_SMOOTH, is_smooth)
            painter.setPen(pen)
            painter.drawPath(path)
        painter.setRenderHint(_SMOOTH)
        to_scene = self.sceneTransform()
        painter.setTransform(to_scene.inverted()[0], True)
        for pen, brush, path, points in self._symbols:
            painter.setPen(pen)
            painter.setBrush(brush)
            for point in points:
                painter.drawPath(path.translated(to_scene.map(point)))
        painter.restore()

    def _add_curve(self, curve: Series, theme: Theme) -> None:
        look = look_of(curve)
        colour = look.colour(theme)
        x, y = np.array(curve.x, np.float64), np.array(curve.y)
        if curve.spread is not None:
            ends = np.array([curve.ends(i) for i in range(len(x))])
            bars = pg.arrayToQPath(np.repeat(x, 2), ends.ravel(), connect="pairs")
            self._lines.append((pg.mkPen(colour, width=1), bars, False))
        self._lines.append((look.pen(theme), pg.arrayToQPath(x, y), True))
        points = [QPointF(*at) for at in zip(curve.x, curve.y, strict=True)]
        some = points[:: ceil(len(points) / SYMBOLS)]
        symbol = _symbol(look.symbol, SYMBOL_PX)
        pen = pg.mkPen(colour, width=1.5)
        self._symbols.append((pen, pg.mkBrush(theme.plot), symbol, some))

    def _add_paper(self, curve: Series, theme: Theme) -> None:
        """Mark the paper's values, right of shorter curves, hollow for a dashed one."""
        colour = look_of(curve).colour(theme)
        inside, edge = (theme.plot, colour) if curve.dashed else (colour, theme.plot)
        right = (1 + MARGIN / 2) * self._last
        places = [QPointF(x if x <= self._last else right, y) for x, y, _ in curve.published]
        mark = _symbol(PAPER_SYMBOL, PAPER_PX)
        self._symbols.append((pg.mkPen(edge, width=1), pg.mkBrush(inside), mark, places))


def last_x(panel: Panel) -> float:
    """Return where the longest curve ends."""
    return float(max(max(one.x) for one in panel.series))


def _symbol(name: str, size_px: float) -> QPainterPath:
    path: QPainterPath = QTransform.fromScale(size_px, size_px).map(Symbols[name])
    return path
