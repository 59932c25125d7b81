"""Texts from files and boards are shown as they are: no label or tooltip takes them for HTML."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QTextDocument
from PySide6.QtWidgets import QApplication, QLabel

from gui.widgets.labels import label, plain_tooltip, show_text

EVIL = "<img src='/etc/passwd'><b>A</b> & B"


@pytest.mark.parametrize("text", [EVIL, f"{EVIL}\n{EVIL}", "plain & <", "sessions\n<b>x</b>", ""])
def test_a_tooltip_shows_tags(qapp: QApplication, text: str) -> None:
    tooltip = plain_tooltip(text)
    shown = tooltip
    if tooltip != text:  # Qt takes it for HTML
        document = QTextDocument()
        document.setHtml(tooltip)
        shown = document.toPlainText()
    assert shown == text


def test_a_label_shows_tags(qapp: QApplication) -> None:
    widget: QLabel = label("")
    show_text(widget, EVIL)
    assert widget.textFormat() == Qt.TextFormat.PlainText
    assert "<img" not in widget.toolTip()
