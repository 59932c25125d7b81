"""The probability of each texture as a bar; the bars change with every batch."""

from __future__ import annotations

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.finger.scan_record import ScanRecord
from gui.widgets.colours import blend
from gui.widgets.theme import applied_theme

ROW_PX = 22
_TITLE_PX = 18
_LEAST_ROWS, _LEAST_ROW_PX = 5, 18
_NAME_PX, _VALUE_PX = 26, 96


class ProbabilityBars(QWidget):
    """One row a texture, in a fixed order. A frame and a word mark the set."""

    def __init__(self) -> None:
        super().__init__()
        self.probabilities: dict[str, float] = {}
        self._textures: tuple[str, ...] = ()
        self._set: tuple[str, ...] = ()
        self._named = ""
        self._reserve_height()

    def show_record(self, record: ScanRecord) -> None:
        """Show the newest answer, or none."""
        row = record.prediction
        self.probabilities = dict(row.probabilities) if row is not None else {}
        self._set = tuple(row.texture_set) if row is not None else ()
        self._named = row.texture if row is not None else ""
        self._reserve_height()
        self.update()

    def show_textures(self, textures: tuple[str, ...]) -> None:
        """Show rows for the textures of a protocol, also before there is an answer."""
        if textures != self._textures:
            self._textures = textures
            self._reserve_height()
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw title and rows."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setPen(QColor(theme.muted))
        title = QRectF(0, 0, self.width(), _TITLE_PX)
        painter.drawText(title, Qt.AlignmentFlag.AlignVCenter, "Probability, and the set")
        names = self._names()
        room_px = (self.height() - _TITLE_PX) / max(len(names), 1)
        height = min(room_px, 1.4 * ROW_PX)
        for place, name in enumerate(names):
            self._paint_row(painter, name, _TITLE_PX + place * height, height)

    def _names(self) -> tuple[str, ...]:
        return tuple(sorted(self.probabilities)) or self._textures

    def _reserve_height(self) -> None:
        """Ask for rows as high as their text; the column scrolls where there is no room."""
        rows = max(_LEAST_ROWS * ROW_PX, len(self._names()) * _LEAST_ROW_PX)
        self.setMinimumHeight(_TITLE_PX + rows)

    def _paint_row(self, painter: QPainter, name: str, top: float, height: float) -> None:
        theme, share = applied_theme(), self.probabilities.get(name)
        font = QFont(self.font())
        font.setBold(name == self._named)
        painter.setFont(font)
        painter.setPen(QColor(theme.text))
        middle = Qt.AlignmentFlag.AlignVCenter
        painter.drawText(QRectF(0, top, _NAME_PX, height), middle, name)
        bar = QRectF(_NAME_PX, top + 3, self.width() - _NAME_PX - _VALUE_PX, height - 6)
        painter.fillRect(bar, QColor(blend(theme.muted, theme.panel, 0.15)))
        if share is None:
            return
        filled = QRectF(bar.left(), bar.top(), bar.width() * share, bar.height())
        is_inside = name in self._set
        painter.fillRect(filled, QColor(theme.accent if is_inside else theme.set_point))
        if is_inside:
            painter.setPen(QPen(QColor(theme.text), 1.2))
            painter.drawRect(bar)
        text = f"{share:.1%}".replace("%", "\u202f%") + (" in set" if is_inside else "")
        place = QRectF(bar.right() + 6, top, _VALUE_PX - 6, height)
        painter.setPen(QColor(theme.text))
        painter.drawText(place, middle, text)
