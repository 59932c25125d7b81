"""The numbers in the cells of a matrix, as one item of a plot.

An item of pyqtgraph for each number took 90 ms of the Qt thread at each change of the range.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QTransform
from PySide6.QtWidgets import QApplication, QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from gui.widgets.colours import blend, contrast
from gui.widgets.theme import Theme, scaled_px

LEAST_NUMBER_PX = (30, 15)
"""Width and height of a cell that has room for its number."""


def cell_colour(theme: Theme, share: float) -> str:
    """Return the colour of a cell: the plot's for 0, the accent for 1."""
    return blend(theme.accent, theme.plot, share)


def number_colour(theme: Theme, share: float) -> str:
    """Return the colour of a number, the one of two that stands out more from its cell."""
    behind = cell_colour(theme, share)
    return max(theme.text, theme.plot, key=lambda text: contrast(text, behind))


class CellNumbers(QGraphicsItem):
    """Draws the shares of a square matrix in %, in the middle of their cells, where they fit."""

    def __init__(self, shares: np.ndarray, shown: np.ndarray, theme: Theme) -> None:
        super().__init__()
        self._shares, self._shown = shares, shown
        steps = {round(100 * share) for share in shares[shown].tolist()}
        self._colours = {step: QColor(number_colour(theme, step / 100)) for step in steps}
        self.setZValue(4)

    def boundingRect(self) -> QRectF:
        """Return the matrix, a cell of which is 1 by 1."""
        return QRectF(0, 0, *self._shares.shape[::-1])

    def has_room(self, to_scene: QTransform) -> bool:
        """Tell whether a number fits in a cell."""
        cell = to_scene.mapRect(QRectF(0, 0, 1, 1))
        width, height = (scaled_px(px) for px in LEAST_NUMBER_PX)
        return cell.width() >= width and cell.height() >= height

    def paint(
        self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None
    ) -> None:
        """Draw in the scene's coordinates: the axes are scaled, and one is turned over."""
        to_scene = self.sceneTransform()
        if not self.has_room(to_scene):
            return
        painter.save()
        painter.setTransform(to_scene.inverted()[0], True)
        painter.setFont(QApplication.font())
        for row, column in zip(*np.nonzero(self._shown), strict=True):
            share = self._shares[row, column]
            painter.setPen(self._colours[round(100 * share)])
            cell = to_scene.mapRect(QRectF(column, row, 1, 1))
            painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, f"{100 * share:.0f}")
        painter.restore()
