"""The running accuracy, and which plate was named how often as which."""

from __future__ import annotations

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.widgets.colours import blend
from gui.widgets.labels import elastic, label, show_text
from gui.widgets.layouts import vbox
from gui.widgets.theme import applied_theme, scaled_px
from rigctl.realtime.messages import FingerRunStatus

_AXIS_PX = 22
_LEAST_CELL_PX = 18
_LEAST_SIZE_PX = 150, 130


class ConfusionMatrix(QWidget):
    """Rows are the plates, columns the answers; right ones are on the framed diagonal."""

    def __init__(self) -> None:
        super().__init__()
        self._run = FingerRunStatus()

    def show_run(self, run: FingerRunStatus) -> None:
        """Show the counts of a run."""
        if (run.textures, run.confusion) != (self._run.textures, self._run.confusion):
            self._run = run
            self.updateGeometry()
            self.update()

    def minimumSizeHint(self) -> QSize:
        """Return the size in which each cell has room for its number."""
        cells_px = 2 * _AXIS_PX + _LEAST_CELL_PX * len(self._run.textures)
        return QSize(*(scaled_px(max(cells_px, least)) for least in _LEAST_SIZE_PX))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw names and cells."""
        painter, theme = QPainter(self), applied_theme()
        names = self._run.textures
        if not names:
            return
        axis = scaled_px(_AXIS_PX)
        side = (min(self.width(), self.height()) - 2 * axis) / len(names)
        self._paint_axes(painter, names, side)
        most = max(
            (max(row.values(), default=0) for row in self._run.confusion.values()), default=0
        )
        for i, true in enumerate(names):
            for j, named in enumerate(names):
                count = self._run.confusion.get(true, {}).get(named, 0)
                place = QRectF(2 * axis + j * side, 2 * axis + i * side, side, side)
                cell = place.adjusted(1, 1, -1, -1)
                colour = theme.ok if i == j else theme.bad
                share = 0.55 * count / most if most else 0.0
                painter.fillRect(cell, QColor(blend(colour, theme.plot, share)))
                painter.setPen(QPen(QColor(theme.text if i == j else theme.line), 1))
                painter.drawRect(cell)
                painter.setPen(QColor(theme.text if count else theme.muted))
                painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, f"{count}")

    def _paint_axes(self, painter: QPainter, names: tuple[str, ...], side: float) -> None:
        theme, centre = applied_theme(), Qt.AlignmentFlag.AlignCenter
        length, axis = len(names) * side, scaled_px(_AXIS_PX)
        painter.setPen(QColor(theme.muted))
        painter.drawText(QRectF(2 * axis, 0, length, axis), centre, "named")
        painter.save()
        painter.translate(0, 2 * axis + length)
        painter.rotate(-90)
        painter.drawText(QRectF(0, 0, length, axis), centre, "plate")
        painter.restore()
        painter.setPen(QColor(theme.text))
        for place, name in enumerate(names):
            start = 2 * axis + place * side
            painter.drawText(QRectF(start, axis, side, axis), centre, name)
            painter.drawText(QRectF(axis, start, axis, side), centre, name)


class ConfusionView(QWidget):
    """The accuracy in words above the matrix."""

    def __init__(self) -> None:
        super().__init__()
        self.accuracy, self.matrix = elastic(label("", "heading")), ConfusionMatrix()
        column = vbox(self.accuracy, spacing=2)
        column.addWidget(self.matrix, 1)
        self.setLayout(column)
        self.show_run(FingerRunStatus())

    def show_run(self, run: FingerRunStatus) -> None:
        """Show the answers of a run so far."""
        show_text(self.accuracy, accuracy_words(run))
        self.matrix.show_run(run)


def accuracy_words(run: FingerRunStatus) -> str:
    """Return the running accuracy beside that of guessing."""
    if not run.classified:
        return "Right: no scan is named yet"
    share = f"{run.correct / run.classified:.0%}"
    chance = f", guessing {1 / len(run.textures):.0%}" if run.textures else ""
    return f"Right: {run.correct} of {run.classified} ({share}{chance})".replace("%", "\u202f%")
