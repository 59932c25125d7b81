"""What the point under the pointer is, in words that a screen reader reads, too."""

from __future__ import annotations

from PySide6.QtGui import QAccessible, QAccessibleEvent, QFontMetrics
from PySide6.QtWidgets import QWidget

from gui.widgets.labels import label
from gui.widgets.layouts import vbox

LINES = 3


class Readout(QWidget):
    """Three lines of text, whose height does not change; they describe the plot ``described``."""

    def __init__(self, described: QWidget, hint: str) -> None:
        super().__init__()
        self._described, self._hint = described, hint
        self.label = label("", wraps=True)
        column = vbox(self.label, margins=(8, 2, 8, 2))
        column.addStretch(1)
        self.setLayout(column)
        self.show_words("")

    def show_words(self, words: str) -> None:
        """Show a point in words, or how to choose one."""
        text = words or self._hint
        self.setMinimumHeight(LINES * QFontMetrics(self.font()).lineSpacing() + 4)
        if self.label.text() != text:
            self.label.setText(text)
            self._described.setAccessibleDescription(text)
            changed = QAccessible.Event.DescriptionChanged
            QAccessible.updateAccessibility(QAccessibleEvent(self._described, changed))
