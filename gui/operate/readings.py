"""The drum's present readings; those that are no longer live are grey, with their age."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QSize
from PySide6.QtGui import QFont, QFontMetrics
from PySide6.QtWidgets import QGroupBox

from gui.widgets.data_ages import DataAges, stale_words
from gui.widgets.flow_layout import FlowLayout
from gui.widgets.labels import elastic, label, set_property, show_text
from gui.widgets.layouts import container, hbox, vbox
from rigctl.acquisition.rpc.messages import EngineStatus

NAMES = ("Force", "Speed", "Actuator", "Angle", "Tared", "Homed")
WIDEST = "199.9 mm/s"
LIVE = "The readings are live"


class ReadingBox(QGroupBox):
    """Readings by name, and a line that says how old they are."""

    def __init__(self) -> None:
        super().__init__("Readings")
        self.readings = {name: elastic(label("–", "heading")) for name in NAMES}
        self.age = label("", "muted")
        self._names = [label(name, "muted") for name in NAMES]
        both = zip(self._names, self.readings.values(), strict=True)
        pairs = [container(hbox(name, reading, wide=1)) for name, reading in both]
        self.setLayout(vbox(FlowLayout(*pairs), self.age, spacing=2, margins=(8, 6, 8, 8)))
        self._keep_whole()

    def sizeHint(self) -> QSize:
        """Return the size for one reading in a line; the panel decides how many there are."""
        return QSize(self.minimumSizeHint().width(), super().sizeHint().height())

    def changeEvent(self, event: QEvent) -> None:
        """Keep the readings whole when the texts become larger."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.FontChange and hasattr(self, "_names"):
            self._keep_whole()

    def _keep_whole(self) -> None:
        bold = QFont(self.font())
        bold.setBold(True)
        name_px = max(map(QFontMetrics(self.font()).horizontalAdvance, NAMES))
        for name, reading in zip(self._names, self.readings.values(), strict=True):
            name.setMinimumWidth(name_px)
            reading.setMinimumWidth(QFontMetrics(bold).horizontalAdvance(WIDEST))

    def show_status(self, status: EngineStatus) -> None:
        """Show the readings; those of a lost drum stay, and their age tells."""
        if not status.drum_connected:
            return
        texts = {
            "Force": f"{status.force_g:.1f} g",
            "Speed": f"{status.speed_mm_s:.1f} mm/s",
            "Actuator": f"{status.actuator_position_um / 1000:.2f} mm",
            "Angle": f"{status.angle_deg:.1f}°",
            "Tared": "yes" if status.tared else "no",
            "Homed": "yes" if status.homed else "no",
        }
        for name, text in texts.items():
            self.readings[name].setText(text)

    def show_ages(self, ages: DataAges) -> None:
        """Turn the readings grey whose data are too old, and say how old they are."""
        drum, loadcell = stale_words(ages.drum_s), stale_words(ages.loadcell_s)
        for name, reading in self.readings.items():
            is_old = bool(drum or (loadcell and name == "Force"))
            set_property(reading, "role", "stale" if is_old else "heading")
        words = f"Not live: {drum}" if drum else f"Force not live: {loadcell}" if loadcell else LIVE
        show_text(self.age, words)
        set_property(self.age, "role", "muted" if words == LIVE else "warn")

    def show_nothing(self) -> None:
        """Show that there is no drum."""
        for reading in self.readings.values():
            reading.setText("–")
            set_property(reading, "role", "muted")
        show_text(self.age, "")
