"""The curves of a plot of accuracy with their bars and symbols, as one item.

Five items of pyqtgraph for each curve took most of the time of making and painting a plot.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil

import numpy as np
import pyqtgraph as pg
from numpy.typing import ArrayLike
from pyqtgraph.graphicsItems.ScatterPlotItem import Symbols
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QBrush, QPainter, QPainterPath, QPen, QTransform
from PySide6.QtWidgets import QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from gui.analysis.figures.accuracy import AccuracyCurve
from gui.analysis.figures.curve_looks import LOOKS, PAPER_PX, PAPER_SYMBOL, SYMBOL_PX
from gui.widgets.theme import Theme

SYMBOLS = 8
TOP_PERCENT, ROOM = 104.0, 0.07
"""The upper end of a plot, and the share of the width of its curves that is right of them."""
_SMOOTH = QPainter.RenderHint.Antialiasing


class AccuracyCurves(QGraphicsItem):
    """Draws curves with bars, a symbol at some of their points, and the paper's values."""

    def __init__(self, curves: Sequence[AccuracyCurve], k_max: int, theme: Theme) -> None:
        super().__init__()
        self._rect = QRectF(0, 0, k_max * (1 + ROOM), TOP_PERCENT)
        self._lines: list[tuple[QPen, QPainterPath, bool]] = []
        self._symbols: list[tuple[QPen, QBrush, QPainterPath, list[QPointF]]] = []
        for curve in curves:
            self._add_curve(curve, theme)
            self._add_paper(curve, k_max, theme)

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

    def _add_curve(self, curve: AccuracyCurve, theme: Theme) -> None:
        look, colour = LOOKS[curve.key], LOOKS[curve.key].colour(theme)
        k = np.arange(1.0, len(curve.percent) + 1)
        self._add_bars(k, curve.percent, curve.spread, colour)
        line = pg.arrayToQPath(k, np.array(curve.percent))
        self._lines.append((look.pen(theme), line, True))
        points = [QPointF(*at) for at in zip(k, curve.percent, strict=True)]
        some = points[:: ceil(len(points) / SYMBOLS)]
        symbol = _symbol(look.symbol, SYMBOL_PX)
        pen = pg.mkPen(colour, width=1.5)
        self._symbols.append((pen, pg.mkBrush(theme.plot), symbol, some))

    def _add_paper(self, curve: AccuracyCurve, k_max: int, theme: Theme) -> None:
        """Mark the paper's value at its components, or right of the curves."""
        if (paper := curve.paper) is None:
            return
        within = paper.components is not None and paper.components <= k_max
        x = float(paper.components or 0) if within else k_max * (1 + ROOM / 2)
        colour = LOOKS[curve.key].colour(theme)
        if paper.sd_percent:
            self._add_bars([x], [paper.percent], [paper.sd_percent], colour)
        mark, pen = _symbol(PAPER_SYMBOL, PAPER_PX), pg.mkPen(theme.plot, width=1)
        self._symbols.append((pen, pg.mkBrush(colour), mark, [QPointF(x, paper.percent)]))

    def _add_bars(
        self, k: ArrayLike, percent: Sequence[float], spread: Sequence[float], colour: str
    ) -> None:
        """Add a thin upright line through each point, as far up and down as its value spreads."""
        if spread:
            ends = np.array(percent)[:, None] + np.outer(spread, (-1.0, 1.0))
            path = pg.arrayToQPath(np.repeat(k, 2), ends.ravel(), connect="pairs")
            self._lines.append((pg.mkPen(colour, width=1), path, False))


def _symbol(name: str, size_px: float) -> QPainterPath:
    path: QPainterPath = QTransform.fromScale(size_px, size_px).map(Symbols[name])
    return path
