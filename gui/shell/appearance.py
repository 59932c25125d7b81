"""Theme and size of the texts of the window, which the settings keep."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QApplication

from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea
from gui.shell.memory.user_settings import UserSettings
from gui.widgets.theme import ThemeChoice, apply_palette, apply_theme, scale_texts

TEXT_SIZES_PERCENT = (90, 100, 115, 130, 150)


class Appearance(QObject):
    """Applies theme and text size to the whole program.

    ``theme`` is the theme in use. Plots have colours of their own and follow ``theme_changed``.
    """

    theme_changed = Signal(object)

    def __init__(self, settings: UserSettings, choice: ThemeChoice, docks: DockArea) -> None:
        super().__init__()
        self._settings, self._choice, self._docks = settings, choice, docks
        scale_texts(self._text_percent() / 100)
        self.theme = apply_palette(choice)
        hints = QApplication.styleHints()
        hints.colorSchemeChanged.connect(lambda _: self._follow_system())

    def add_menus(self, menus: ActionRegistry) -> None:
        """Add the choices of theme and text size to the View menu."""
        themes = {choice.value: choice for choice in ThemeChoice}
        menus.add_choices("View", "&Theme", themes, self._choice, self._choose_theme)
        sizes = {f"{percent} %": percent for percent in TEXT_SIZES_PERCENT}
        size = self._text_percent()
        menus.add_choices("View", "Te&xt size", sizes, size, self.set_text_size)

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

    def _choose_theme(self, choice: ThemeChoice) -> None:
        self._settings.set_value("theme", choice.name)
        self.set_theme(choice)

    def _follow_system(self) -> None:
        if self._choice is ThemeChoice.SYSTEM:
            self.set_theme(self._choice)

    def _text_percent(self) -> int:
        return self._settings.value("text_percent", 100, TEXT_SIZES_PERCENT.__contains__)
