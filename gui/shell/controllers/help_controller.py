"""The Help menu: the shortcut sheet, the documentation, and what the program is."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from gui.shell.actions import ActionRegistry
from gui.shell.help_page import HelpPage, about_text, shortcut_table

DOCS = Path(__file__).parents[2] / "docs" / "README.md"


class HelpController(QObject):
    """Adds the actions of the menu and fills the page that they show."""

    shown = Signal()
    """The page has a text to show."""
    reported = Signal(str, str)

    def __init__(self, menus: ActionRegistry) -> None:
        super().__init__()
        self.page, self._menus = HelpPage(), menus
        tip = "All actions and keys"
        menus.add("Help", "&Shortcuts", self._show_shortcuts, shortcut="F1", tip=tip)
        menus.add("Help", "&Documentation", self._open_docs, tip="Open the documentation")
        tip = "Versions of the program and its parts"
        menus.add("Help", "&About rigctl", self._show_about, tip=tip)

    def _show_shortcuts(self) -> None:
        self.page.show_html("Actions and shortcuts", shortcut_table(self._menus.rows()))
        self.shown.emit()

    def _show_about(self) -> None:
        self.page.show_html("About rigctl", about_text())
        self.shown.emit()

    def _open_docs(self) -> None:
        if DOCS.exists():
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(DOCS)))
        else:
            sentence = f"{DOCS} is missing: the documentation comes with the source"
            self.reported.emit("refused", sentence)
