"""Theme and size of the texts of the window, which the settings keep."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QApplication

from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea
from gui.shell.memory.user_settings import UserSettings
from gui.widgets.theme import ThemeChoice, apply_palette, apply_theme, scale_texts

TEXT_SIZES_PERCENT = (90, 100, 115, 130, 150)
NOT_AT_REST = (
    "theme and text size change once the rig is at rest, lifted and without a run: they keep the "
    "window busy for a second or more, and STOP with it"
)


class Appearance(QObject):
    """Applies theme and text size to the whole program.

    ``theme`` is the theme in use. Plots have colours of their own and follow ``theme_changed``.
    All widgets are styled anew in one piece, and STOP would wait for it: choices are refused
    unless ``is_at_rest``, and a change of the desktop's colours waits.
    """

    theme_changed = Signal(object)
    reported = Signal(str, str)

    def __init__(
        self,
        settings: UserSettings,
        choice: ThemeChoice,
        docks: DockArea,
        is_at_rest: Callable[[], bool],
    ) -> None:
        super().__init__()
        self._settings, self._choice, self._docks = settings, choice, docks
        self._is_at_rest, self._system_changed = is_at_rest, False
        self._themes: dict[Any, QAction] = {}
        self._sizes: dict[Any, QAction] = {}
        scale_texts(self._text_percent() / 100)
        self.theme = apply_palette(choice)
        hints = QApplication.styleHints()
        hints.colorSchemeChanged.connect(lambda _: self._note_system())

    def add_menus(self, menus: ActionRegistry) -> None:
        """Add the choices of theme and text size to the View menu."""
        themes = {choice.value: choice for choice in ThemeChoice}
        self._themes = menus.add_choices("View", "&Theme", themes, self._choice, self._choose_theme)
        sizes = {f"{percent} %": percent for percent in TEXT_SIZES_PERCENT}
        size = self._text_percent()
        self._sizes = menus.add_choices("View", "Te&xt size", sizes, size, self._choose_text_size)

    def apply(self) -> None:
        """Style the widgets, once they are made."""
        apply_theme(self._choice)

    def set_theme(self, choice: ThemeChoice) -> None:
        """Apply another theme."""
        self._choice = choice
        self.theme = apply_theme(choice)
        self.theme_changed.emit(self.theme)

    def set_text_size(self, percent: int) -> None:
        """Show all texts larger or smaller, in percent of the usual size."""
        before, widths_px = self._text_percent(), self._docks.asked_widths_px()
        self._settings.set_value("text_percent", percent)
        scale_texts(percent / 100)
        self.set_theme(self._choice)
        widths_px = {name: round(px * percent / before) for name, px in widths_px.items()}
        self._docks.set_side_widths(widths_px)

    def follow_system(self) -> None:
        """Take the desktop's colours, if they have changed, once the rig is at rest."""
        if self._system_changed and self._is_at_rest():
            self._system_changed = False
            if self._choice is ThemeChoice.SYSTEM:
                self.set_theme(self._choice)

    def _choose_theme(self, choice: ThemeChoice) -> None:
        if self._may_change(self._themes[self._choice]):
            self._settings.set_value("theme", choice.name)
            self.set_theme(choice)

    def _choose_text_size(self, percent: int) -> None:
        if self._may_change(self._sizes[self._text_percent()]):
            self.set_text_size(percent)

    def _may_change(self, present: QAction) -> bool:
        """Return whether the rig is at rest; say why not, and mark the present choice again."""
        if self._is_at_rest():
            return True
        present.setChecked(True)
        self.reported.emit("refused", NOT_AT_REST)
        return False

    def _note_system(self) -> None:
        self._system_changed = True
        self.follow_system()

    def _text_percent(self) -> int:
        return self._settings.value("text_percent", 100, TEXT_SIZES_PERCENT.__contains__)
