"""The Help menu: the shortcut sheet, the documentation, crash reports, what the program is."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, QUrl, Signal
from PySide6.QtGui import QDesktopServices

from gui.shell.actions import ActionRegistry
from gui.shell.help_page import HelpPage, about_text, shortcut_table

DOCS = Path(__file__).parents[3] / "docs" / "README.md"


class HelpController(QObject):
    """Adds the actions of the menu and fills the page that they show."""

    shown = Signal()
    """The page has a text to show."""
    reported = Signal(str, str)

    def __init__(self, menus: ActionRegistry, reports: Path) -> None:
        super().__init__()
        self.page, self._menus, self._reports = HelpPage(), menus, reports
        tip = "All actions and keys"
        menus.add("Help", "&Shortcuts", self._show_shortcuts, shortcut="F1", tip=tip)
        menus.add("Help", "&Documentation", self._open_docs, tip="Open the documentation")
        tip = "Open the folder with the reports of errors that nobody expected"
        menus.add("Help", "&Crash reports", self._open_reports, tip=tip)
        tip = "Versions of the program and its parts"
        menus.add("Help", "&About rigctl", self._show_about, tip=tip)

    def _show_shortcuts(self) -> None:
        self.page.show_html("Actions and shortcuts", shortcut_table(self._menus.rows()))
        self.shown.emit()

    def _show_about(self) -> None:
        self.page.show_html("About rigctl", about_text(QUrl.fromLocalFile(str(DOCS)).toString()))
        self.shown.emit()

    def _open_docs(self) -> None:
        if DOCS.exists():
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(DOCS)))
            self.reported.emit("opened", f"opened {DOCS}")
        else:
            sentence = f"{DOCS} is missing: the documentation comes with the source"
            self.reported.emit("refused", sentence)

    def _open_reports(self) -> None:
        folder = self._reports
        if not any(folder.glob("*.txt")):
            self.reported.emit("help", "there are no crash reports")
            return
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))
        self.reported.emit("opened", f"opened {folder}")
