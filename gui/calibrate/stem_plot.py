"""A small plot of errors in g: for each place a point above or below a line in the middle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.widgets.theme import Theme, applied_theme, scaled_px

LEFT_PX, BOTTOM_PX, TOP_PX, RIGHT_PX = 62, 34, 20, 14
POINT_PX = 4.0


class Stem(NamedTuple):
    """An error: ``place`` from 0 at the left to 1 at the right, ``name`` below it."""

    place: float
    error_g: float
    name: str


class StemPlot(QWidget):
    """Draws stems; ``hint`` stands in place of them. ``title`` says what both axes are."""

    def __init__(self, title: str, hint: str) -> None:
        super().__init__()
        self.stems: list[Stem] = []
        self._title, self._hint = title, hint
        self.setAccessibleName(title)

    def minimumSizeHint(self) -> QSize:
        """Return the size that the title needs in two lines."""
        return QSize(max(self._title_px * 5 // 8, scaled_px(200)), scaled_px(150))

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(min(self._title_px, scaled_px(300)), scaled_px(150))

    @property
    def _title_px(self) -> int:
        return self.fontMetrics().horizontalAdvance(self._title) + 4

    def show_stems(self, stems: Sequence[Stem], unit: str = "") -> None:
        """Show errors; ``unit`` follows each name in words."""
        if list(stems) != self.stems:
            self.stems = list(stems)
            lines = [f"{stem.name}{unit}: {stem.error_g:+.2f} g" for stem in stems]
            self.setToolTip("\n".join(lines))
            self.setAccessibleDescription("; ".join(lines))
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw frame, axes and points."""
        painter, theme = QPainter(self), applied_theme()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        left, top, right, bottom = map(scaled_px, (LEFT_PX, TOP_PX, RIGHT_PX, BOTTOM_PX))
        top *= 1 if self._title_px <= self.width() else 2
        area = QRectF(self.rect()).adjusted(left, top, -right, -bottom)
        painter.fillRect(area, QColor(theme.plot))
        painter.setPen(QColor(theme.muted))
        title = QRectF(0, 0, self.width(), top)
        centre = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
        painter.drawText(title, centre, self._title)
        if self.stems:
            self._draw(painter, area, theme)
        else:
            painter.drawText(area, Qt.AlignmentFlag.AlignCenter, self._hint)
        painter.setPen(QColor(theme.line))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRect(area)

    def _draw(self, painter: QPainter, area: QRectF, theme: Theme) -> None:
        most_g = max(0.1, *(abs(stem.error_g) for stem in self.stems)) * 1.25
        self._draw_axis(painter, area, most_g, theme)
        right_px = -1.0
        for stem in self.stems:
            x = area.left() + 8 + stem.place * (area.width() - 16)
            y = area.center().y() - stem.error_g / most_g * area.height() / 2
            painter.setPen(QPen(QColor(theme.accent), 1.5))
            painter.drawLine(QPointF(x, area.center().y()), QPointF(x, y))
            painter.setBrush(QColor(theme.accent))
            painter.drawEllipse(QPointF(x, y), POINT_PX, POINT_PX)
            right_px = self._draw_name(painter, area, x, stem.name, right_px, theme)

    def _draw_axis(self, painter: QPainter, area: QRectF, most_g: float, theme: Theme) -> None:
        painter.setPen(QPen(QColor(theme.muted), 1, Qt.PenStyle.DashLine))
        middle = area.center().y()
        painter.drawLine(QPointF(area.left(), middle), QPointF(area.right(), middle))
        half = scaled_px(8)
        ends = area.top() + half - 1, area.bottom() - half + 1
        for value_g, y in ((most_g, ends[0]), (0.0, middle), (-most_g, ends[1])):
            text = f"{value_g:+.2f}" if value_g else "0"
            place = QRectF(0, y - half, area.left() - 6, 2 * half)
            flags = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            painter.drawText(place, flags, text.replace("-", "−"))

    def _draw_name(
        self, painter: QPainter, area: QRectF, x: float, text: str, free_px: float, theme: Theme
    ) -> float:
        """Write a name below its point unless another one is there; return where there is room."""
        width = painter.fontMetrics().horizontalAdvance(text)
        left = min(max(0.0, x - width / 2), self.width() - width)
        if left < free_px:
            return free_px
        painter.setPen(QColor(theme.muted))
        place = QRectF(left - 1, area.bottom() + 4, width + 2, scaled_px(18))
        painter.drawText(place, Qt.AlignmentFlag.AlignCenter, text)
        return left + width + 6
