"""How old the newest data of each source are, and from when on they are no longer live."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter
from PySide6.QtWidgets import QGraphicsItem, QGraphicsWidget

from gui.widgets.formatting import duration
from gui.widgets.theme import applied_theme
from rigctl.engine.rpc.messages import EngineStatus

STALE_S = 0.4
"""Values this old are shown grey with their age; data come at least ten times a second."""


@dataclass(frozen=True, slots=True)
class DataAges:
    """Seconds since the newest data of each source; None before any."""

    engine_s: float | None = None
    drum_s: float | None = None
    loadcell_s: float | None = None
    taxels_s: float | None = None


def data_ages(status: EngineStatus, since_status_s: float) -> DataAges:
    """Return the ages that a status reported, ``since_status_s`` after it came."""

    def older(age_s: float | None) -> float | None:
        return None if age_s is None else age_s + since_status_s

    return DataAges(
        since_status_s,
        older(status.poll_age_s),
        older(status.loadcell_age_s),
        older(status.last_block_age_s),
    )


def stale_words(age_s: float | None) -> str:
    """Return the age of data that are no longer live, empty for live ones and before any."""
    if age_s is None or age_s <= STALE_S:
        return ""
    if age_s < 10:
        return f"{age_s:.1f} s old"
    whole_s = age_s if age_s < 60 else age_s - age_s % 60  # a narrow plot has no room for both
    return f"{duration(whole_s).removesuffix(' 00 s')} old"


VEIL_ALPHA = 205
_ABOVE_ALL = 1000.0


class StaleCover(QGraphicsItem):
    """Covers its parent and names the age; hidden, and free of cost, over live data."""

    def __init__(self, covered: QGraphicsWidget, what: str) -> None:
        super().__init__(covered)
        self.text = ""
        self._covered, self._what = covered, what
        self._rect = QRectF(covered.rect())
        covered.geometryChanged.connect(self._fit)
        self.setZValue(_ABOVE_ALL)
        self.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
        self.setVisible(False)

    def show_age(self, words: str) -> None:
        """Cover the plot with the age of its data; empty words uncover it."""
        if words == self.text:
            return
        self.text = words
        self.setVisible(bool(words))
        self.prepareGeometryChange()
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the whole parent; Qt asks for it also while it deletes the parent."""
        return self._rect

    def _fit(self) -> None:
        self.prepareGeometryChange()
        self._rect = QRectF(self._covered.rect())

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw the veil and, in its middle, what is old and how old it is."""
        theme = applied_theme()
        veil = QColor(theme.line)
        veil.setAlpha(VEIL_ALPHA)
        painter.fillRect(self.boundingRect(), veil)
        font = QFont(painter.font())
        font.setWeight(QFont.Weight.DemiBold)
        painter.setFont(font)
        painter.setPen(QColor(theme.text))
        area, whole = self.boundingRect(), f"not live: {self._what} {self.text}"
        is_narrow = painter.fontMetrics().horizontalAdvance(whole) > area.width()
        text = f"{self._what}\n{self.text}" if is_narrow else whole
        painter.drawText(area, Qt.AlignmentFlag.AlignCenter, text)


class StaleCovers:
    """The covers of all live plots, by the source of their data."""

    def __init__(
        self, force: QGraphicsWidget, drum: QGraphicsWidget, *taxels: QGraphicsWidget
    ) -> None:
        self.force = StaleCover(force, "load cell")
        self.drum = StaleCover(drum, "drum")
        self.taxels = [StaleCover(item, "taxels") for item in taxels]

    def show_ages(self, ages: DataAges) -> None:
        """Cover the plots whose newest data are too old."""
        self.force.show_age(stale_words(ages.loadcell_s))
        self.drum.show_age(stale_words(ages.drum_s))
        for cover in self.taxels:
            cover.show_age(stale_words(ages.taxels_s))
