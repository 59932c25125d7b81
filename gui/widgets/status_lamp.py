"""A light that says its level by shape as well as by colour."""

from __future__ import annotations

from enum import StrEnum

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.theme import Theme


class Level(StrEnum):
    """How well something is."""

    OFF = "off"
    OK = "ok"
    WARN = "warn"
    BAD = "bad"


class StatusLamp(QWidget):
    """Ring: unknown or off. Disc: good. Diamond: look. Triangle: bad."""

    def __init__(self, theme: Theme, side_px: int = 14) -> None:
        super().__init__()
        self._theme = theme
        self._side_px = side_px
        self.level = Level.OFF
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)

    def set_theme(self, theme: Theme) -> None:
        """Shine in other colours."""
        self._theme = theme
        self.update()

    def set_level(self, level: Level) -> None:
        """Show another level."""
        if level is not self.level:
            self.level = level
            self.update()

    def sizeHint(self) -> QSize:
        """A square."""
        return QSize(self._side_px, self._side_px)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the level's shape."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        box = QRectF(self.rect()).adjusted(1.5, 1.5, -1.5, -1.5)
        if self.level is Level.OFF:
            painter.setPen(QPen(QColor(self._theme.muted), 1.6))
            painter.drawEllipse(box)
            return
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(QColor(getattr(self._theme, self.level.value)))
        if self.level is Level.OK:
            painter.drawEllipse(box)
        else:
            painter.drawPolygon(_diamond(box) if self.level is Level.WARN else _triangle(box))


def _diamond(box: QRectF) -> QPolygonF:
    middle = box.center()
    return QPolygonF(
        [
            QPointF(middle.x(), box.top()),
            QPointF(box.right(), middle.y()),
            QPointF(middle.x(), box.bottom()),
            QPointF(box.left(), middle.y()),
        ]
    )


def _triangle(box: QRectF) -> QPolygonF:
    return QPolygonF([QPointF(box.center().x(), box.top()), box.bottomRight(), box.bottomLeft()])
