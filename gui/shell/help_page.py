"""A page of text: the shortcut sheet, and what the program is."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from html import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from PySide6.QtCore import QObject, QUrl, Signal, qVersion
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QTextBrowser, QWidget

from gui.shell.actions import ActionRegistry, ActionRow
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, vbox

FIXED_KEYS = (
    ActionRow("Always", "STOP", "Esc", "Stop and lift the drum, and end every run"),
    ActionRow("Always", "Next or previous control", "Tab, Shift+Tab", "Move the keyboard's focus"),
    ActionRow("Always", "Press a button", "Return, Space", "The one that has the focus"),
    ActionRow("Operate", "Jog 1 mm", "Alt+Left, Alt+Right", "With Shift 10 mm"),
    ActionRow("Plots", "Pause or follow", "Space; End", "End follows the newest samples again"),
    ActionRow("Plots", "Look back", "Left, Right", "A tenth of the axis; Page up, Page down: all"),
    ActionRow("Plots", "Oldest samples", "Home", "Up to eleven minutes ago"),
    ActionRow("Plots", "Zoom", "+, −", "In a pause"),
    ActionRow("Plots", "Move the cursor", "Ctrl+Left, Ctrl+Right", "Values stand below the plots"),
    ActionRow("Plots", "Set the reference", "C", "The second line then shows differences from it"),
    ActionRow("Plots", "Choose a taxel", "Up, Down", "Return shows it alone, or all again"),
    ActionRow("Trials", "Replay the chosen trial", "Return", "As a double click on its row"),
    ActionRow("Trials", "To the columns' names", "Up", "From the first row; Down leads back"),
    ActionRow("Trials, columns", "Choose a column", "Left, Right", "Home, End: the first or last"),
    ActionRow("Trials, columns", "Sort", "Return, Space", "Rising, falling, as recorded"),
    ActionRow("Trials", "Filter", "Letters", "Return leads from the filter to the rows"),
    ActionRow("Accuracy", "Choose components", "Left, Right", "Home, End: the first or the last"),
    ActionRow("Accuracy", "Choose a curve", "Up, Down", "Page up, Page down: the task"),
    ActionRow("Confusion", "Choose a cell", "Arrow keys", "The line below names its trials"),
    ActionRow("Accuracy, Confusion", "Zoom", "+, −", "0 shows the whole plot again"),
)


class HelpPage(QWidget):
    """Shows one text at a time; *Back* returns to the page before."""

    closed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.title, self.text = label("", "heading"), QTextBrowser(openExternalLinks=True)
        self.back = push_button("Back", self.closed.emit)
        head = hbox(self.title, self.back, margins=(8, 0, 0, 0))
        self.setLayout(vbox(head, self.text, spacing=4))

    def show_html(self, title: str, html: str) -> None:
        """Show a text."""
        self.title.setText(title)
        self.text.setHtml(html)
        self.text.setFocus()


def shortcut_table(rows: Iterable[ActionRow]) -> str:
    """Return all actions as a table in HTML, the keys that no menu lists first."""
    cells = "".join(_table_row(row) for row in (*FIXED_KEYS, *rows))
    head = "<tr><th align='left'>Menu</th><th align='left'>Action</th>"
    head += "<th align='left'>Keys</th><th align='left'>What it does</th></tr>"
    return f"<table cellpadding='3'>{head}{cells}</table>"


def about_text(docs: str) -> str:
    """Return name, purpose, a link to the documentation and versions as HTML."""
    lines = "".join(f"<li>{escape(line)}</li>" for line in version_lines())
    return (
        "<p><b>rigctl</b> controls a drum rig of a tactile laboratory, records its sensor, "
        "encodes the readings as spikes and names textures.</p>"
        f"<p><a href='{escape(docs, quote=True)}'>Documentation</a></p><ul>{lines}</ul>"
    )


def version_lines() -> list[str]:
    """Return the versions of the program and of what it stands on, for people who help."""
    return [
        f"rigctl {_version('rigctl')}",
        f"Python {platform.python_version()}",
        f"Qt {qVersion()}, PySide6 {_version('PySide6-Essentials')}",
        f"pyqtgraph {_version('pyqtgraph')}, NumPy {_version('numpy')}",
        platform.platform(),
    ]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "from a checkout"


def _table_row(row: ActionRow) -> str:
    return "<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>"


DOCS = Path(__file__).parents[2] / "docs" / "README.md"


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
