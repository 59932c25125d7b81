"""A map of the sensor from above: which place to press, and what is known of the others."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.widgets.theme import Theme, applied_theme, scaled_px
from rigctl.acquisition.calibration.wiring_identification import (
    PER_LAYER,
    SIDE,
    place_name,
    reading_name,
)

PRESS, FLAT = "Press", "Press all"
GAP_PX = 4


class SensorMap(QWidget):
    """Nine places, row 1 at the top. A place to press has a thick frame and the word “Press”.

    Known places have a check mark and the readings of their two taxels.
    """

    def __init__(self) -> None:
        super().__init__()
        self.asked: tuple[int, ...] = ()
        self.known: tuple[tuple[int, int], ...] = ()
        self.setAccessibleName("Map of the sensor")

    def minimumSizeHint(self) -> QSize:
        """Return the size that the names of the readings need."""
        return QSize(scaled_px(224), scaled_px(170))

    def sizeHint(self) -> QSize:
        """Return a size that suits a small window."""
        return QSize(scaled_px(340), scaled_px(190))

    def show_places(self, asked: Sequence[int], known: Sequence[tuple[int, int]]) -> None:
        """Show the places to press, and the two readings of each place that is known."""
        if (tuple(asked), tuple(known)) == (self.asked, self.known):
            return
        self.asked, self.known = tuple(asked), tuple(known)
        words = [f"{place_name(place)}: {self.text_of(place)}" for place in range(PER_LAYER)]
        self.setAccessibleDescription("; ".join(words).replace("\n", " "))
        self.update()

    def text_of(self, place: int) -> str:
        """Return what stands at a place."""
        if place in self.asked:
            return FLAT if len(self.asked) > 1 else PRESS
        if place < len(self.known):
            upper, lower = map(reading_name, self.known[place])
            return f"✓\n{upper}\n{lower}"
        return "?"

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the places."""
        painter, theme = QPainter(self), applied_theme()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        width, height = self.width() / SIDE, self.height() / SIDE
        for place in range(PER_LAYER):
            row, column = divmod(place, SIDE)
            cell = QRectF(column * width, row * height, width, height)
            self._draw(painter, place, cell.adjusted(GAP_PX, GAP_PX, -GAP_PX, -GAP_PX), theme)

    def _draw(self, painter: QPainter, place: int, cell: QRectF, theme: Theme) -> None:
        is_asked = place in self.asked
        painter.setPen(QPen(QColor(theme.accent if is_asked else theme.line), 4 if is_asked else 1))
        painter.setBrush(QColor(theme.plot))
        painter.drawRoundedRect(cell, 5, 5)
        font = painter.font()
        font.setBold(is_asked)
        painter.setFont(font)
        painter.setPen(QColor(theme.text if is_asked or place < len(self.known) else theme.muted))
        painter.drawText(cell, Qt.AlignmentFlag.AlignCenter, self.text_of(place))
