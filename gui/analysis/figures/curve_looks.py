"""Colour, dashes and symbol of each curve: a curve is told from others without colour."""

from __future__ import annotations

from typing import NamedTuple

import pyqtgraph as pg
from pyqtgraph.graphicsItems.ScatterPlotItem import Symbols
from PySide6.QtCore import QPointF, QSize, Qt
from PySide6.QtGui import QIcon, QPainter, QPainterPath, QPen, QPixmap

from gui.widgets.theme import DARK, Theme
from rigctl.analysis.report.figure import Series

SAMPLE = QSize(34, 14)
SYMBOL_PX, PAPER_PX = 8, 13
PAPER_SYMBOL = "d"
DASHES = (3.0, 2.0)


class CurveLook(NamedTuple):
    """The paper's colour on white and on black, dashes in widths of the line, and a symbol."""

    light: str
    dark: str
    dashes: tuple[float, ...]
    symbol: str

    def colour(self, theme: Theme) -> str:
        """Return the colour in a theme."""
        return self.dark if theme is DARK else self.light

    def pen(self, theme: Theme) -> QPen:
        """Return the pen of the curve."""
        pen: QPen = pg.mkPen(self.colour(theme), width=2, dash=list(self.dashes) or None)
        return pen

    def sample(self, theme: Theme) -> QIcon:
        """Return a piece of the curve for a legend."""
        pixmap = QPixmap(SAMPLE * 2)
        pixmap.setDevicePixelRatio(2)
        pixmap.fill(Qt.GlobalColor.transparent)
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = SAMPLE.height() / 2
        painter.setPen(self.pen(theme))
        painter.drawLine(QPointF(0, middle), QPointF(SAMPLE.width(), middle))
        painter.translate(SAMPLE.width() / 2, middle)
        painter.setPen(pg.mkPen(self.colour(theme)))
        painter.setBrush(pg.mkBrush(theme.plot))
        painter.scale(SYMBOL_PX, SYMBOL_PX)
        path: QPainterPath = Symbols[self.symbol]
        painter.pen().setCosmetic(True)
        painter.drawPath(path)
        painter.end()
        return QIcon(pixmap)


COLOURS = {
    "ink": ("#111111", "#e6e9ed"),
    "red": ("#c8102e", "#ff7a85"),
    "blue": ("#1f4fd1", "#86a8ff"),
    "green": ("#1a8a34", "#5fd07a"),
}
SYMBOLS_OF = {"ink": ("o", "h"), "red": ("t1", "t"), "blue": ("s", "d"), "green": ("star", "x")}
"""Symbols of curves that are drawn through, and of dashed ones."""


def look_of(curve: Series) -> CurveLook:
    """Return how a curve is drawn."""
    symbol = SYMBOLS_OF[curve.colour][curve.dashed]
    return CurveLook(*COLOURS[curve.colour], DASHES if curve.dashed else (), symbol)
