"""Labels, and the style properties of widgets."""

from __future__ import annotations

from html import escape

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget


def label(text: str = "", role: str = "", wraps: bool = False) -> QLabel:
    """Return a label; the theme styles its ``role`` (muted, heading, value, state, bad)."""
    widget = QLabel(text, wordWrap=wraps, textFormat=Qt.TextFormat.PlainText)
    widget.setProperty("role", role)
    return widget


def elastic(widget: QLabel) -> QLabel:
    """Let a label shrink below the width of its text; the tooltip then shows the rest."""
    widget.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    return widget


def show_text(widget: QLabel, text: str) -> None:
    """Set a label's text and tooltip, only if the text changed."""
    if widget.text() != text:
        widget.setText(text)
        widget.setToolTip(plain_tooltip(text))


def plain_tooltip(text: str) -> str:
    """Return a tooltip that shows ``text`` as it is: Qt takes a tag in the first line for HTML."""
    return escape(text).replace("\n", "<br>") if "<" in text.partition("\n")[0] else text


def set_property(widget: QWidget, name: str, value: str) -> None:
    """Set a property that selectors of the style sheet use, and apply the style."""
    if widget.property(name) != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
