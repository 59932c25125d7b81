"""The plate seen from above, to scale: its marks, and where the finger is and was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.colours import blend
from gui.widgets.theme import Theme, applied_theme, scaled_px
from rigctl.protocol.finger import MARKS_MM, PLATE_MM, PLATE_WIDTH_MM
from rigctl.realtime.messages import FingerEngineStatus

_LINE_PX, _ONE_LINE_PX = 20, 330
"""Height of a line of text, and the width in which title and position share one."""
_ALONG_MM, _ACROSS_MM = 18.0, 6.0
"""Shown before and after the plate, and beside it: the finger begins and ends there."""
_SHOWN_MM = (PLATE_MM + 2 * _ALONG_MM, PLATE_WIDTH_MM + 2 * _ACROSS_MM)
_MAX_PLATE_PX = 170
_MAX_POINTS = 400
_FINGER_PX = 7.0
_TICK_MM = 50


class PlateView(QWidget):
    """Draws the plate, the path of the present slide and the finger.

    A filled disc touches the plate, a ring is lifted, a cross is a tracker that lost its reference.
    """

    def __init__(self) -> None:
        super().__init__()
        self.path_mm = np.zeros((0, 2))
        self._texture = ""
        self._status = FingerEngineStatus()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show position and contact."""
        self._status = status
        scan = status.run.scan
        self._texture = scan.texture if scan is not None else ""
        self.update()

    def show_path(self, along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]) -> None:
        """Show the valid positions of the slide so far, mm, (n,)."""
        step = max(1, -(-len(along_mm) // _MAX_POINTS))
        path = np.column_stack([along_mm, across_mm])
        self.path_mm = np.concatenate([path[::step], path[-1:]])
        self.update()

    @property
    def words(self) -> str:
        """What the tracker and the sensor say, in words and mm."""
        status = self._status
        if not status.tracker_connected or status.position_age_s is None:
            return "no position"
        if not status.position_valid:
            return "tracker lost"
        place = f"along {status.along_mm:.0f} mm, across {status.across_mm:+.0f} mm"
        contact = "in contact" if status.in_contact else "not in contact"
        return f"{contact}, {place}".replace("-", "−")

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Take the height at which the plate fills the width."""
        super().resizeEvent(event)
        self._take_height()

    def changeEvent(self, event: QEvent) -> None:
        """Take the height of larger texts."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange:
            self._take_height()

    def _take_height(self) -> None:
        plate_px = min(self.width() * _SHOWN_MM[1] / _SHOWN_MM[0], _MAX_PLATE_PX)
        self.setFixedHeight(round(plate_px) + self._title_px + scaled_px(_LINE_PX))

    @property
    def _title_px(self) -> int:
        lines = 1 if self.width() >= scaled_px(_ONE_LINE_PX) else 2
        return lines * scaled_px(_LINE_PX)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw everything in the colours of the applied theme."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._set_scale()
        self._paint_title(painter, theme)
        self._paint_plate(painter, theme)
        self._paint_path(painter, theme)
        if self._status.position_age_s is not None:
            self._paint_finger(painter, theme)

    def _set_scale(self) -> None:
        width_mm, height_mm = _SHOWN_MM
        room_px = self.height() - self._title_px - scaled_px(_LINE_PX)
        self._px_per_mm = min(self.width() / width_mm, room_px / height_mm)
        self._left_px = (self.width() - PLATE_MM * self._px_per_mm) / 2
        self._middle_px = self._title_px + room_px / 2

    def _at(self, along_mm: float, across_mm: float) -> QPointF:
        """Return a place on the widget; left of the way is up, as seen from above."""
        return QPointF(
            self._left_px + along_mm * self._px_per_mm,
            self._middle_px - across_mm * self._px_per_mm,
        )

    def _paint_title(self, painter: QPainter, theme: Theme) -> None:
        plate = f"Plate {self._texture}" if self._texture else "Plate"
        title = f"{plate} from above, {PLATE_MM:.0f} × {PLATE_WIDTH_MM:.0f} mm"
        line_px = scaled_px(_LINE_PX)
        first = QRectF(4, 0, self.width() - 8, line_px)
        last = first.translated(0, self._title_px - line_px)
        advance, share_line = painter.fontMetrics().horizontalAdvance, first == last
        if advance(title) + share_line * (advance(self.words) + 8) > first.width():
            title = plate
        side = Qt.AlignmentFlag.AlignRight if share_line else Qt.AlignmentFlag.AlignLeft
        painter.setPen(QColor(theme.muted))
        painter.drawText(first, Qt.AlignmentFlag.AlignVCenter, title)
        painter.setPen(QColor(theme.text))
        painter.drawText(last, side | Qt.AlignmentFlag.AlignVCenter, self.words)

    def _paint_plate(self, painter: QPainter, theme: Theme) -> None:
        half = PLATE_WIDTH_MM / 2
        painter.setPen(QPen(QColor(theme.line), 1.5))
        painter.setBrush(QColor(theme.plot))
        painter.drawRoundedRect(QRectF(self._at(0, half), self._at(PLATE_MM, -half)), 3, 3)
        begin, end = MARKS_MM
        inside = QRectF(self._at(begin, half), self._at(end, -half))
        painter.fillRect(inside, QColor(blend(theme.accent, theme.plot, 0.12)))
        painter.setPen(QPen(QColor(theme.accent), 1.5, Qt.PenStyle.DashLine))
        for mark in MARKS_MM:
            painter.drawLine(self._at(mark, half + 4), self._at(mark, -half - 4))
        painter.setPen(QColor(theme.muted))
        self._paint_ticks(painter)

    def _paint_ticks(self, painter: QPainter) -> None:
        """Draw the texts below the plate: the marks first, others where there is room."""
        ticks = range(0, round(PLATE_MM) + 1, _TICK_MM)
        drawn: list[QRectF] = []
        line_px = scaled_px(_LINE_PX)
        for tick in sorted(ticks, key=lambda tick: tick not in MARKS_MM):
            text = _tick_text(tick)
            width = painter.fontMetrics().horizontalAdvance(text) + 2
            left = min(max(self._at(tick, 0).x() - width / 2, 0), self.width() - width)
            area = QRectF(left, self.height() - line_px, width, line_px)
            if not any(area.adjusted(-4, 0, 4, 0).intersects(other) for other in drawn):
                painter.drawText(area, Qt.AlignmentFlag.AlignCenter, text)
                drawn.append(area)

    def _paint_path(self, painter: QPainter, theme: Theme) -> None:
        if len(self.path_mm) < 2:
            return
        painter.setPen(QPen(QColor(theme.groups[1]), 1.6))
        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.drawPolyline(QPolygonF([self._at(x, y) for x, y in self.path_mm.tolist()]))

    def _paint_finger(self, painter: QPainter, theme: Theme) -> None:
        status, r = self._status, _FINGER_PX
        area = QRectF(self.rect()).adjusted(r, self._title_px, -r, -scaled_px(_LINE_PX))
        newest = self.path_mm[-1].tolist() if len(self.path_mm) and status.position_valid else None
        place = self._at(*(newest or (status.along_mm, status.across_mm)))
        x = min(max(place.x(), area.left()), area.right())
        y = min(max(place.y(), area.top()), area.bottom())
        painter.setPen(QPen(QColor(theme.text if status.position_valid else theme.bad), 2.0))
        if not status.position_valid:
            painter.drawLine(QPointF(x - r, y - r), QPointF(x + r, y + r))
            painter.drawLine(QPointF(x - r, y + r), QPointF(x + r, y - r))
            return
        painter.setBrush(QColor(theme.groups[1]) if status.in_contact else Qt.BrushStyle.NoBrush)
        painter.drawEllipse(QPointF(x, y), r, r)


def _tick_text(tick_mm: int) -> str:
    names = dict(zip(MARKS_MM, ("start", "end"), strict=True))
    name = names.get(float(tick_mm))
    return f"{name} {tick_mm} mm" if name else f"{tick_mm} mm"
