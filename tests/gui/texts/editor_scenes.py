"""The states of the editor of protocols in which its texts are measured."""

from __future__ import annotations

from collections.abc import Iterator

from PySide6.QtWidgets import QApplication, QScrollArea

from gui.protocol.protocol_panel import ProtocolPanel
from rigctl.config import resources
from tests.gui.steps import click, wait_until

MISTAKES = 'forces_g = [40, "much"]\nspeeds_mm_s = [8000]\ntextures = ["A", "A"]\n'
TALL_STEP = '[[steps]]\nat = "every"\nkind = "approach_only"\n'


def editor_scenes(panel: ProtocolPanel) -> Iterator[str]:
    """Show the form of each experiment, with and without mistakes, and the text."""
    editor = panel.page.editor
    panel.show_page(True)
    panel.page.tabs.setCurrentWidget(editor)
    texts = {
        "whole": (resources.protocols() / "showcase.toml").read_text(encoding="utf-8"),
        "mistakes": MISTAKES + TALL_STEP,
        "finger": (resources.finger_protocols() / "quick.toml").read_text(encoding="utf-8"),
        "no TOML": "textures = oops\n",
    }
    for name, text in texts.items():
        editor.text.setPlainText(text)
        wait_until(lambda: not panel.worker.is_busy and not editor.is_checking)
        for end in ("top", "bottom"):
            _scroll(editor.views.currentWidget(), end)
            yield f"Form of a protocol, {name}, {end}"
    click(editor.text_button)
    QApplication.processEvents()
    yield "Text of a protocol"
    click(editor.form_button)
    panel.show_page(False)


def _scroll(area: object, end: str) -> None:
    assert isinstance(area, QScrollArea)
    QApplication.processEvents()
    bar = area.verticalScrollBar()
    bar.setValue(bar.maximum() if end == "bottom" else 0)
    QApplication.processEvents()
