"""Small widgets that several panels are made of."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget


def label(text: str = "", role: str = "", wraps: bool = False) -> QLabel:
    """A text; ``role`` picks its look from the theme (muted, heading, value, state, bad)."""
    made = QLabel(text)
    made.setProperty("role", role)
    made.setWordWrap(wraps)
    made.setTextFormat(Qt.TextFormat.PlainText)
    return made


def elastic(made: QLabel) -> QLabel:
    """Let a label become as narrow as the place; what does not fit is in its tool tip."""
    made.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    return made


def show_text(made: QLabel, text: str) -> None:
    """Set a text and the same as tool tip, only when it changed."""
    if made.text() != text:
        made.setText(text)
        made.setToolTip(text)


def set_property(widget: QWidget, name: str, value: str) -> None:
    """Change a property that the style sheet looks at."""
    if widget.property(name) != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
