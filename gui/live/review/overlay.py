"""Lines over a plot: events with their names, the cursor, and the reference cursor."""

from __future__ import annotations

from typing import NamedTuple

from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QFontMetricsF, QPainter, QPen, QTransform
from PySide6.QtWidgets import QGraphicsItem

from gui.widgets.theme import Theme, text_scale

_ROOM_PX = 8
_LABEL_PT = 7.5


class MarkLine(NamedTuple):
    """An event at a time of the axis, with its name and whether it is a problem."""

    at_s: float
    name: str
    is_problem: bool


class Overlay(QGraphicsItem):
    """Vertical lines over one plot; ``names_marks``: also write the names of the events."""

    def __init__(self, theme: Theme, names_marks: bool) -> None:
        super().__init__()
        self.theme = theme
        self.marks: list[MarkLine] = []
        self.cursor_s: float | None = None
        self.reference_s: float | None = None
        self._names_marks = names_marks
        self._rect = QRectF(-10.0, 0.0, 10.0, 1.0)
        self.setZValue(10)

    def set_theme(self, theme: Theme) -> None:
        """Apply a theme."""
        self.theme = theme
        self.update()

    def set_rect(self, rect: QRectF) -> None:
        """Set the rectangle of the plot in its own units."""
        if rect != self._rect:
            self.prepareGeometryChange()
            self._rect = rect

    def show_lines(
        self, marks: list[MarkLine], cursor_s: float | None, reference_s: float | None
    ) -> None:
        """Show events and cursors at times of the axis; None hides a cursor."""
        if (marks, cursor_s, reference_s) != (self.marks, self.cursor_s, self.reference_s):
            self.marks, self.cursor_s, self.reference_s = marks, cursor_s, reference_s
            self.update()

    def boundingRect(self) -> QRectF:
        """Return the rectangle of the whole plot."""
        return self._rect

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the lines in pixels, so that text and dashes keep their size."""
        if not self.marks and self.cursor_s is None and self.reference_s is None:
            return
        to_pixels = painter.worldTransform()
        painter.save()
        painter.setWorldTransform(QTransform())
        area = to_pixels.mapRect(self._rect)
        self._paint_marks(painter, to_pixels, area)
        for at_s, colour, style in (
            (self.reference_s, self.theme.accent, Qt.PenStyle.DashLine),
            (self.cursor_s, self.theme.text, Qt.PenStyle.SolidLine),
        ):
            if at_s is not None:
                self._paint_line(painter, _x_of(to_pixels, at_s), area, colour, style)
        painter.restore()

    def _paint_marks(self, painter: QPainter, to_pixels: QTransform, area: QRectF) -> None:
        font = QFont(painter.font())
        font.setPointSizeF(_LABEL_PT * text_scale())
        painter.setFont(font)
        metrics, free_from = QFontMetricsF(font), area.left()
        for at_s, name, is_problem in self.marks:
            x = _x_of(to_pixels, at_s)
            colour = self.theme.bad if is_problem else self.theme.muted
            style = Qt.PenStyle.DashDotLine if is_problem else Qt.PenStyle.DotLine
            self._paint_line(painter, x, area, colour, style)
            width = metrics.horizontalAdvance(name)
            if self._names_marks and x >= free_from and x + width + 3 <= area.right():
                painter.drawText(QPointF(x + 3, area.top() + metrics.ascent() + 1), name)
                free_from = x + width + _ROOM_PX

    def _paint_line(
        self, painter: QPainter, x: float, area: QRectF, colour: str, style: Qt.PenStyle
    ) -> None:
        painter.setPen(QPen(QColor(colour), 1, style))
        painter.drawLine(QLineF(x, area.top(), x, area.bottom()))


def _x_of(to_pixels: QTransform, at_s: float) -> float:
    return round(to_pixels.map(QPointF(at_s, 0.0)).x()) + 0.5
