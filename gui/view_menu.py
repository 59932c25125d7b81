"""The View menu: the theme, and the length of the live plots' time axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PySide6.QtCore import Signal, SignalInstance
from PySide6.QtGui import QActionGroup
from PySide6.QtWidgets import QMenu, QWidget

from gui.widgets.theme import ThemeChoice

SPANS_S = (2, 5, 10)


class ViewMenu(QMenu):
    """Two groups of exclusive choices."""

    theme_chosen = Signal(object)
    """The :class:`ThemeChoice`."""
    span_chosen = Signal(int)
    """Length of the time axis, s."""

    def __init__(self, parent: QWidget, theme: ThemeChoice) -> None:
        super().__init__("&View", parent)
        themes = {choice.value: choice for choice in ThemeChoice}
        self._add_choices("&Theme", themes, theme, self.theme_chosen)
        spans = {f"{span_s} s": span_s for span_s in SPANS_S}
        self._add_choices("Time &span", spans, SPANS_S[-1], self.span_chosen)

    def _add_choices(
        self, title: str, choices: Mapping[str, Any], checked: Any, chosen: SignalInstance
    ) -> None:
        menu, group = self.addMenu(title), QActionGroup(self)
        for text, value in choices.items():
            action = menu.addAction(text)
            action.setCheckable(True)
            action.setChecked(value == checked)
            action.triggered.connect(lambda _=False, v=value: chosen.emit(v))
            group.addAction(action)
