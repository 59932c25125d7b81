"""A confusion matrix whose cells can be chosen with pointer or keys."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent
from PySide6.QtWidgets import QGraphicsRectItem

from gui.analysis.figures.cell_numbers import CellNumbers, cell_colour
from gui.widgets.plot_axes import PlotGrid, colour_axes
from gui.widgets.theme import Theme
from rigctl.analysis.report.figure import Matrix

LEAST_CELL_PX, AXIS_PX = (18, 13), 60
ZOOM = 1.25
_Key = Qt.Key
_STEPS = {
    _Key.Key_Left: (0, -1), _Key.Key_Right: (0, 1), _Key.Key_Up: (-1, 0), _Key.Key_Down: (1, 0),
}  # fmt: skip


class ConfusionPlotView(PlotGrid):
    """Rows are true classes, columns predicted ones; a cell shows its share of the row in %."""

    cell_changed = Signal(str)
    """The chosen cell in words, empty for none."""

    def __init__(self, theme: Theme, matrix: Matrix) -> None:
        super().__init__()
        self._theme, self.matrix = theme, matrix
        self.cell: tuple[int, int] | None = None
        self._frame = QGraphicsRectItem()
        self.item = self.cells.addPlot(enableMenu=False)
        self.item.hideButtons()
        self.item.invertY(True)
        self.item.setLabels(left="True texture", bottom="Predicted texture")
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.graphics.installEventFilter(self)
        self.graphics.setAccessibleName("Confusion matrix")
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour_background(theme)
        colour_axes(self.item, theme)
        self.show_matrix(self.matrix)

    def show_matrix(self, matrix: Matrix) -> None:
        """Show another matrix."""
        self.matrix = matrix
        n = len(matrix.classes)
        self.item.clear()
        theme = self._theme
        share = np.array([[matrix.share(row, column) for column in range(n)] for row in range(n)])
        image = pg.ImageItem(_colours(share, theme), axisOrder="row-major", levels=(0, 255))
        image.setRect(QRectF(0, 0, n, n))
        self.item.addItem(image)
        self.numbers = CellNumbers(share, share > 0, theme)
        self.item.addItem(self.numbers, ignoreBounds=True)
        for side in ("left", "bottom"):
            names = [(place + 0.5, name) for place, name in enumerate(matrix.classes)]
            self.item.getAxis(side).setTicks([names, []])
        self.reserve_plots(*(n * px + AXIS_PX for px in LEAST_CELL_PX))
        self.item.setLimits(xMin=0, xMax=n, yMin=0, yMax=n, minXRange=1, minYRange=1)
        self._choose(None)
        self.show_whole_range()

    def show_whole_range(self) -> None:
        """Undo the zoom."""
        n = len(self.matrix.classes)
        self.item.setRange(xRange=(0, n), yRange=(0, n), padding=0)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take the keys that choose a cell or zoom."""
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.KeyPress:
            return self._press(event)
        return super().eventFilter(watched, event)

    def _point_at(self, place: QPointF) -> None:
        view = self.item.getViewBox()
        if view.sceneBoundingRect().contains(place):
            at = view.mapSceneToView(place)
            self._choose((int(np.floor(at.y())), int(np.floor(at.x()))))

    def _choose(self, cell: tuple[int, int] | None) -> None:
        """Choose a cell, or the nearest one of the matrix."""
        if self._frame.scene() is not None:
            self.item.removeItem(self._frame)
        words = ""
        if cell is not None:
            most = len(self.matrix.classes) - 1
            cell = min(max(cell[0], 0), most), min(max(cell[1], 0), most)
            words = self.matrix.words(*cell)
            self._frame = QGraphicsRectItem(QRectF(cell[1], cell[0], 1, 1))
            self._frame.setPen(pg.mkPen(self._theme.accent, width=3))
            self._frame.setZValue(5)
            self.item.addItem(self._frame, ignoreBounds=True)
        self.cell = cell
        self.cell_changed.emit(words)

    def _press(self, event: QKeyEvent) -> bool:
        key = event.key()
        if key in _STEPS:
            down, right = _STEPS[_Key(key)]
            self._choose((self.cell[0] + down, self.cell[1] + right) if self.cell else (0, 0))
        elif key in (_Key.Key_Plus, _Key.Key_Equal, _Key.Key_Minus):
            factor = ZOOM if key == _Key.Key_Minus else 1 / ZOOM
            at = pg.Point(self.cell[1] + 0.5, self.cell[0] + 0.5) if self.cell else None
            self.item.getViewBox().scaleBy((factor, factor), center=at)
        elif key == _Key.Key_0:
            self.show_whole_range()
        else:
            return False
        return True


def _colours(share: np.ndarray, theme: Theme) -> np.ndarray:
    """Return the colour of each cell, uint8 (n, n, 3): the plot's for 0, the accent for 1."""
    ramp = [QColor(cell_colour(theme, step / 100)) for step in range(101)]
    table = np.array([(c.red(), c.green(), c.blue()) for c in ramp], np.uint8)
    colours: np.ndarray = table[np.rint(100 * share).astype(int)]
    return colours
