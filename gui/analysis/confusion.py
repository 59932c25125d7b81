"""The page of confusion matrices, whose cells can be chosen with pointer or keys."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QPainter, QTransform
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QGraphicsItem,
    QGraphicsRectItem,
    QStyleOptionGraphicsItem,
    QWidget,
)

from gui.analysis.export import Picture, widget_picture
from gui.widgets.labels import label
from gui.widgets.layouts import FlowLayout, combo_box, container, push_button, vbox
from gui.widgets.plot_axes import PlotGrid, Readout, add_plot
from gui.widgets.theme import Theme, blend, contrast, scaled_px
from rigctl.analysis.report.figure import Figure, Matrix

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
        self.item = add_plot(self.cells, 0, 0)
        self.item.invertY(True)
        self.item.setLabel("left", "True texture")
        self.item.setLabel("bottom", "Predicted texture")
        self.graphics.scene().sigMouseMoved.connect(self._point_at)
        self.graphics.installEventFilter(self)
        self.graphics.setAccessibleName("Confusion matrix")
        self.set_theme(theme)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self._theme = theme
        self.colour(theme, self.item)
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
        self.item.addItem(self.numbers)
        for side in ("left", "bottom"):
            names = [(place + 0.5, name) for place, name in enumerate(matrix.classes)]
            self.item.getAxis(side).setTicks([names, []])
        self.reserve_plots(*(n * px + AXIS_PX for px in LEAST_CELL_PX))
        self.item.getViewBox().setLimits(xMin=0, xMax=n, yMin=0, yMax=n, minXRange=1, minYRange=1)
        self._choose(None)
        self.show_whole_range()

    def show_whole_range(self) -> None:
        """Undo the zoom."""
        n = len(self.matrix.classes)
        self.item.getViewBox().setRange(xRange=(0, n), yRange=(0, n), padding=0)

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
            self.item.addItem(self._frame)
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


HINT = (
    "Point at a cell to read it, or use the arrow keys; + and − zoom, 0 shows the whole matrix. "
    "A number is the share of the true texture in %."
)


class ConfusionPage(QWidget):
    """One matrix at a time."""

    def __init__(self, theme: Theme, figures: Sequence[Figure], origin: str) -> None:
        super().__init__()
        self._figures = {one.title: one for one in figures}
        self.task = combo_box({title: title for title in self._figures})
        self.task.setAccessibleName("Task")
        self.representation = combo_box({})
        self.representation.setAccessibleName("Representation")
        self.view = ConfusionPlotView(theme, figures[0].matrices[0])
        self.whole_button = push_button(
            "Whole matrix", self.view.show_whole_range, "Undo the zoom (0)"
        )
        self.name, self.words = label("", "heading", wraps=True), label("", wraps=True)
        self.readout = Readout(self.view.graphics, HINT)
        self._lay_out(origin)
        self._offer_representations()
        self.task.currentIndexChanged.connect(lambda _: self._offer_representations())
        self.representation.currentIndexChanged.connect(lambda _: self._show())
        self.view.cell_changed.connect(self.readout.show_words)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.view.set_theme(theme)

    def picture(self) -> Picture:
        """Return the matrix with what it is as a picture."""
        return widget_picture(self._figure)

    def _matrices(self) -> dict[str, Matrix]:
        """Return the matrices of the task by their representation."""
        return {one.name: one for one in self._figures[self.task.currentData()].matrices}

    def _offer_representations(self) -> None:
        """Offer those of the task, and keep the one that is chosen."""
        names, before = list(self._matrices()), self.representation.currentText()
        self.representation.blockSignals(True)
        self.representation.clear()
        for name in names:
            self.representation.addItem(name, name)
        self.representation.setCurrentIndex(max(self.representation.findText(before), 0))
        self.representation.blockSignals(False)
        self._show()

    def _show(self) -> None:
        matrix = self._matrices()[self.representation.currentData()]
        self.name.setText(f"{self.task.currentText()} · {matrix.title}")
        self.words.setText("; ".join(matrix.subtitle))
        if matrix is not self.view.matrix:
            self.view.show_matrix(matrix)

    def _lay_out(self, origin_words: str) -> None:
        origin = label(origin_words, "muted", wraps=True)
        column = vbox(
            self.name, self.words, self.view, origin, spacing=2, margins=(8, 0, 8, 0), tall=2
        )
        self._figure = container(column)
        for box in (self.task, self.representation):
            box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToContents)
        boxes = (self.task, self.representation, self.whole_button)
        head = FlowLayout(*boxes, margins=(8, 6, 8, 2))
        self.setLayout(vbox(head, self._figure, self.readout, tall=1))
