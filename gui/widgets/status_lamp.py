"""A lamp that shows its level by shape as well as by colour."""

from __future__ import annotations

from enum import StrEnum

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from gui.widgets.theme import applied_theme


class Level(StrEnum):
    """The verdict on a value."""

    OFF = "off"
    OK = "ok"
    WARN = "warn"
    BAD = "bad"


class StatusLamp(QWidget):
    """A ring (off or unknown), a disc (OK), a diamond (WARN) or a triangle (BAD)."""

    def __init__(self, side_px: int) -> None:
        super().__init__()
        self.level = Level.OFF
        self.setFixedSize(side_px, side_px)

    def set_level(self, level: Level) -> None:
        """Show another level."""
        if level is not self.level:
            self.level = level
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the level's shape in the colours of the applied theme."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        box = QRectF(self.rect()).adjusted(1.5, 1.5, -1.5, -1.5)
        if self.level is Level.OFF:
            painter.setPen(QPen(QColor(theme.muted), 1.6))
            painter.drawEllipse(box)
            return
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(getattr(theme, self.level)))
        if self.level is Level.OK:
            painter.drawEllipse(box)
        else:
            painter.drawPolygon(_diamond(box) if self.level is Level.WARN else _triangle(box))


def _diamond(box: QRectF) -> QPolygonF:
    x, y = box.center().x(), box.center().y()
    corners = ((x, box.top()), (box.right(), y), (x, box.bottom()), (box.left(), y))
    return QPolygonF([QPointF(*corner) for corner in corners])


def _triangle(box: QRectF) -> QPolygonF:
    return QPolygonF([QPointF(box.center().x(), box.top()), box.bottomRight(), box.bottomLeft()])
