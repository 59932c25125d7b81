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


_CORNERS = {
    Level.WARN: ((0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5)),
    Level.BAD: ((0.5, 0.0), (1.0, 1.0), (0.0, 1.0)),
}


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
            width, height = box.width(), box.height()
            corners = [QPointF(x * width, y * height) for x, y in _CORNERS[self.level]]
            painter.drawPolygon(QPolygonF(corners).translated(box.topLeft()))
