"""A strip below the heading that asks something; it covers nothing."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFrame, QLabel, QLayout, QPushButton

from gui.widgets.layouts import hbox
from gui.widgets.status_lamp import Level, StatusLamp


class Strip(QFrame):
    """A lamp, a sentence and buttons; hidden until it has something to say."""

    def __init__(self) -> None:
        super().__init__()
        self.setProperty("role", "prompt")
        self.text = QLabel(wordWrap=True, textFormat=Qt.TextFormat.PlainText)
        self.text.setProperty("role", "heading")
        self.hide()

    def row(self, *buttons: QPushButton, level: Level = Level.WARN) -> QLayout:
        """Return a layout of the lamp, the sentence and the buttons."""
        lamp = StatusLamp(18)
        lamp.set_level(level)
        margins = (10, 6, 10, 6)
        return hbox(lamp, self.text, *buttons, wide=1, spacing=6, margins=margins)
