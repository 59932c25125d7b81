"""The probability of each texture as a bar; the bars change with every batch."""

from __future__ import annotations

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from gui.finger.scan_record import ScanRecord
from gui.widgets.colours import blend
from gui.widgets.theme import applied_theme, scaled_px

ROW_PX = 22
_TITLE_PX = 18
_LEAST_ROWS, _LEAST_ROW_PX = 5, 18
_NAME_PX, _VALUE_PX, _LEAST_BAR_PX = 26, 106, 50


class ProbabilityBars(QWidget):
    """One row a texture, in a fixed order. A frame and a word mark the set."""

    def __init__(self) -> None:
        super().__init__()
        self.probabilities: dict[str, float] = {}
        self._textures: tuple[str, ...] = ()
        self._set: tuple[str, ...] = ()
        self._named = ""

    def show_record(self, record: ScanRecord) -> None:
        """Show the newest answer, or none."""
        row = record.prediction
        self.probabilities = dict(row.probabilities) if row is not None else {}
        self._set = tuple(row.texture_set) if row is not None else ()
        self._named = row.texture if row is not None else ""
        self.updateGeometry()
        self.update()

    def show_textures(self, textures: tuple[str, ...]) -> None:
        """Show rows for the textures of a protocol, also before there is an answer."""
        if textures != self._textures:
            self._textures = textures
            self.updateGeometry()
            self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw title and rows."""
        theme = applied_theme()
        painter = QPainter(self)
        painter.setPen(QColor(theme.muted))
        title_px = scaled_px(_TITLE_PX)
        title = QRectF(0, 0, self.width(), title_px)
        painter.drawText(title, Qt.AlignmentFlag.AlignVCenter, "Probability, and the set")
        names = self._names()
        room_px = (self.height() - title_px) / max(len(names), 1)
        height = min(room_px, 1.4 * scaled_px(ROW_PX))
        for place, name in enumerate(names):
            self._paint_row(painter, name, title_px + place * height, height)

    def _names(self) -> tuple[str, ...]:
        return tuple(sorted(self.probabilities)) or self._textures

    def minimumSizeHint(self) -> QSize:
        """Return rows as high as their text; the column scrolls where there is no room."""
        rows_px = max(_LEAST_ROWS * ROW_PX, len(self._names()) * _LEAST_ROW_PX)
        width_px = _NAME_PX + _LEAST_BAR_PX + _VALUE_PX
        return QSize(scaled_px(width_px), scaled_px(_TITLE_PX + rows_px))

    def _paint_row(self, painter: QPainter, name: str, top: float, height: float) -> None:
        theme, share = applied_theme(), self.probabilities.get(name)
        font = QFont(self.font())
        font.setBold(name == self._named)
        painter.setFont(font)
        painter.setPen(QColor(theme.text))
        middle = Qt.AlignmentFlag.AlignVCenter
        name_px, value_px = scaled_px(_NAME_PX), scaled_px(_VALUE_PX)
        painter.drawText(QRectF(0, top, name_px, height), middle, name)
        bar = QRectF(name_px, top + 3, self.width() - name_px - value_px, height - 6)
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
        place = QRectF(bar.right() + 6, top, value_px - 6, height)
        painter.setPen(QColor(theme.text))
        painter.drawText(place, middle, text)
