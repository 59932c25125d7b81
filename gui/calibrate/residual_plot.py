"""The residual of each known mass: how far it is from the line that is the scale."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.widgets.theme import Theme, applied_theme

LEFT_PX, BOTTOM_PX, TOP_PX, RIGHT_PX = 62, 34, 20, 14
POINT_PX = 4.0
TITLE = "Mass less the line (g) over the mass (g)"
HINT = "Two readings make a line"


class ResidualPlot(QWidget):
    """A point for each mass; the line in the middle is the scale."""

    def __init__(self) -> None:
        super().__init__()
        self.points: list[tuple[float, float]] = []
        self.setMinimumSize(200, 130)
        self.setAccessibleName(TITLE)

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(300, 150)

    def show_points(self, masses_g: Sequence[float], residuals_g: Sequence[float]) -> None:
        """Show residuals; none for no line."""
        points = list(zip(masses_g, residuals_g, strict=True))
        if points != self.points:
            self.points = points
            lines = [f"{mass:g} g: {residual:+.2f} g" for mass, residual in points]
            self.setToolTip("\n".join(lines))
            self.setAccessibleDescription("; ".join(lines))
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw frame, axes and points."""
        painter, theme = QPainter(self), applied_theme()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        area = QRectF(self.rect()).adjusted(LEFT_PX, TOP_PX, -RIGHT_PX, -BOTTOM_PX)
        painter.fillRect(area, QColor(theme.plot))
        painter.setPen(QColor(theme.muted))
        top = QRectF(0, 0, self.width(), TOP_PX)
        painter.drawText(top, Qt.AlignmentFlag.AlignCenter, TITLE)
        if self.points:
            self._draw(painter, area, theme)
        else:
            painter.drawText(area, Qt.AlignmentFlag.AlignCenter, HINT)
        painter.setPen(QColor(theme.line))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawRect(area)

    def _draw(self, painter: QPainter, area: QRectF, theme: Theme) -> None:
        most_g = max(0.1, *(abs(residual) for _, residual in self.points)) * 1.25
        widest_g = max(mass for mass, _ in self.points) or 1.0
        self._draw_axis(painter, area, most_g, theme)
        right_px = -1.0
        for mass, residual in self.points:
            x = area.left() + 8 + mass / widest_g * (area.width() - 16)
            y = area.center().y() - residual / most_g * area.height() / 2
            painter.setPen(QPen(QColor(theme.accent), 1.5))
            painter.drawLine(QPointF(x, area.center().y()), QPointF(x, y))
            painter.setBrush(QColor(theme.accent))
            painter.drawEllipse(QPointF(x, y), POINT_PX, POINT_PX)
            right_px = self._draw_mass(painter, area, x, f"{mass:g}", right_px, theme)

    def _draw_axis(self, painter: QPainter, area: QRectF, most_g: float, theme: Theme) -> None:
        painter.setPen(QPen(QColor(theme.muted), 1, Qt.PenStyle.DashLine))
        middle = area.center().y()
        painter.drawLine(QPointF(area.left(), middle), QPointF(area.right(), middle))
        for value_g, y in ((most_g, area.top() + 7), (0.0, middle), (-most_g, area.bottom() - 7)):
            text = f"{value_g:+.2f}" if value_g else "0"
            place = QRectF(0, y - 8, LEFT_PX - 6, 16)
            flags = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            painter.drawText(place, flags, text.replace("-", "−"))

    def _draw_mass(
        self, painter: QPainter, area: QRectF, x: float, text: str, free_px: float, theme: Theme
    ) -> float:
        """Write a mass below its point unless another one is there; return where there is room."""
        width = painter.fontMetrics().horizontalAdvance(text)
        left = min(max(0.0, x - width / 2), self.width() - width)
        if left < free_px:
            return free_px
        painter.setPen(QColor(theme.muted))
        place = QRectF(left - 1, area.bottom() + 4, width + 2, 18)
        painter.drawText(place, Qt.AlignmentFlag.AlignCenter, text)
        return left + width + 6
