"""What a part of the setup is about: its box in the wiring drawing, or the load cell's course."""

from __future__ import annotations

import math
from collections import deque

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.theme import applied_theme, scaled_px
from rigctl.config.resources import part_title, wiring_drawing
from rigctl.engine.rpc.messages import EngineStatus

MARGIN = 8.0
SHOWN_S = 30.0
LEAST_SPAN_G = 20.0
TRACE_TITLE = "Load cell (g), last 30 s"


class PartDrawing(QWidget):
    """One part of a wiring drawing at the largest undistorted size, on white."""

    def __init__(self) -> None:
        super().__init__()
        self._pages: dict[str, QSvgRenderer] = {}
        self._picture = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)

    def sizeHint(self) -> QSize:
        """Return a size at which the names of the pins can be read."""
        return QSize(scaled_px(460), scaled_px(190))

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size that shows anything."""
        return QSize(scaled_px(160), scaled_px(90))

    def show_part(self, picture: str) -> None:
        """Show a part, ``page#id``, or nothing."""
        if picture != self._picture:
            self._picture = picture
            self.setAccessibleName(f"Wiring: {part_title(picture)}" if picture else "")
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the part in the middle."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), Qt.GlobalColor.white)
        page, _, part = self._picture.partition("#")
        drawing = self._drawing(page)
        if not drawing.isValid():
            return
        room = QRectF(self.rect()).adjusted(MARGIN, MARGIN, -MARGIN, -MARGIN)
        shown = drawing.boundsOnElement(part).size()
        place = QRectF(QPointF(), shown.scaled(room.size(), Qt.AspectRatioMode.KeepAspectRatio))
        place.moveCenter(room.center())
        drawing.render(painter, part, place)

    def _drawing(self, page: str) -> QSvgRenderer:
        """Return a page of the drawing, which is read once."""
        if page not in self._pages:
            self._pages[page] = QSvgRenderer(str(wiring_drawing(page)) if page else "")
        return self._pages[page]


class CellTrace(QWidget):
    """The load cell's reading over the last half minute, with its range at the left."""

    def __init__(self) -> None:
        super().__init__()
        self._points: deque[tuple[float, float]] = deque()
        self.setAccessibleName(TRACE_TITLE)

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(scaled_px(300), scaled_px(130))

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size that shows a curve."""
        return QSize(scaled_px(160), scaled_px(90))

    def add(self, status: EngineStatus) -> None:
        """Add the newest reading."""
        points, at_s = self._points, status.at_s
        if points and at_s < points[-1][0]:
            points.clear()  # of another engine
        points.append((at_s, status.force_g))
        while at_s - points[0][0] > SHOWN_S:
            points.popleft()
        if self.isVisible():
            self.update()

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw title, range and curve."""
        painter, theme = QPainter(self), applied_theme()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), QColor(theme.plot))
        line_px = self.fontMetrics().height()
        painter.setPen(QColor(theme.muted))
        painter.drawText(QPointF(MARGIN, line_px), TRACE_TITLE)
        if not self._points:
            return
        low_g, high_g = self._range_g()
        left_px = self.fontMetrics().horizontalAdvance("−00000 ") + MARGIN
        room = QRectF(self.rect()).adjusted(left_px, 1.6 * line_px, -MARGIN, -MARGIN)
        for top_px, value_g in ((room.top(), high_g), (room.bottom() - line_px, low_g)):
            place = QRectF(MARGIN, top_px, left_px - MARGIN, line_px)
            painter.drawText(place, Qt.AlignmentFlag.AlignLeft, f"{value_g:.0f}")
        painter.setPen(QPen(QColor(theme.line), 1))
        painter.drawRect(room)
        painter.setPen(QPen(QColor(theme.accent), 1.5))
        painter.drawPolyline([self._place(room, point, low_g, high_g) for point in self._points])

    def _range_g(self) -> tuple[float, float]:
        """Return round ends of an axis that holds all readings."""
        values = [value for _, value in self._points]
        middle, span = (min(values) + max(values)) / 2, max(values) - min(values)
        half = max(LEAST_SPAN_G, 1.1 * span) / 2
        return math.floor(middle - half), math.ceil(middle + half)

    def _place(
        self, room: QRectF, point: tuple[float, float], low_g: float, high_g: float
    ) -> QPointF:
        age = (self._points[-1][0] - point[0]) / SHOWN_S
        height = (point[1] - low_g) / (high_g - low_g)
        return QPointF(room.right() - age * room.width(), room.bottom() - height * room.height())
