"""The page Help: the shortcut sheet, what the program is, and reports of unexpected errors."""

from __future__ import annotations

import faulthandler
import platform
import sys
import threading
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import datetime
from html import escape
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import TextIO

from PySide6.QtCore import QObject, QUrl, Signal, qVersion
from PySide6.QtGui import QDesktopServices
from PySide6.QtWidgets import QTextBrowser, QWidget

from gui.shell.actions import ActionRegistry, ActionRow
from gui.widgets.labels import label
from gui.widgets.layouts import hbox, push_button, vbox
from rigctl.config.resources import documentation

FIXED_KEYS = (
    ActionRow(
        "Always",
        "STOP",
        "Esc",
        "Stop and lift the drum, and end every run; at rest, close what is open first",
    ),
    ActionRow("Always", "Next or previous control", "Tab, Shift+Tab", "Move the keyboard's focus"),
    ActionRow("Always", "Press a button", "Return, Space", "The one that has the focus"),
    ActionRow("Operate", "Jog 1 mm", "Alt+Left, Alt+Right", "With Shift 10 mm"),
    ActionRow("Plots", "Pause or follow", "Space; End", "End follows the newest samples again"),
    ActionRow("Plots", "Look back", "Left, Right", "A tenth of the axis; Page up, Page down: all"),
    ActionRow("Plots", "Oldest samples", "Home", "Up to eleven minutes ago"),
    ActionRow("Plots", "Zoom", "+, −", "In a pause"),
    ActionRow("Plots", "Zoom force", "Ctrl+Up, Ctrl+Down", "With Shift speed; 0 shows all again"),
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


class HelpPage(QWidget):
    """Shows one text at a time; *Back* returns to the page before.

    Its actions are in the menu Help.
    """

    closed = Signal()
    shown = Signal()
    """The page has a text to show."""
    reported = Signal(str, str)

    def __init__(self, menus: ActionRegistry, reports: Path) -> None:
        super().__init__()
        self._menus, self._reports = menus, reports
        self.title, self.text = label("", "heading"), QTextBrowser(openLinks=False)
        self.text.anchorClicked.connect(self._open)
        self.back = push_button("Back", self.closed.emit)
        head = hbox(self.title, self.back, margins=(8, 0, 0, 0))
        self.setLayout(vbox(head, self.text, spacing=4))
        tip = "All actions and keys"
        menus.add("Help", "&Shortcuts", self._show_shortcuts, shortcut="F1", tip=tip)
        menus.add("Help", "&Documentation", self._open_docs, tip="Open the documentation")
        tip = "Open the folder with the reports of errors that nobody expected"
        menus.add("Help", "&Crash reports", self._open_reports, tip=tip)
        tip = "Versions of the program and its parts"
        menus.add("Help", "&About rigctl", self._show_about, tip=tip)

    def _show(self, title: str, html: str) -> None:
        self.title.setText(title)
        self.text.setHtml(html)
        self.text.setFocus()
        self.shown.emit()

    def _show_shortcuts(self) -> None:
        self._show("Actions and shortcuts", shortcut_table(self._menus.rows()))

    def _show_about(self) -> None:
        self._show("About rigctl", about_text(QUrl.fromLocalFile(str(documentation())).toString()))

    def _open_docs(self) -> None:
        page = documentation()
        if page.exists():
            self._open(QUrl.fromLocalFile(str(page)))
        else:
            sentence = f"{page} is missing: this installation was packed without documentation"
            self.reported.emit("refused", sentence)

    def _open_reports(self) -> None:
        folder = self._reports
        if not any(folder.glob("*.txt")):
            self.reported.emit("help", "there are no crash reports")
            return
        self._open(QUrl.fromLocalFile(str(folder)))

    def _open(self, url: QUrl) -> None:
        """Open a file or a page in the desktop's program for it, and say whether there is one."""
        what = url.toLocalFile() or url.toString()
        if QDesktopServices.openUrl(url):
            self.reported.emit("opened", f"opened {what}")
        else:
            self.reported.emit("refused", f"this desktop has no program to open {what}")


REPORTS = "crash-reports"
"""Folder of the reports, beside the settings."""
NATIVE = "native-crash"
"""File in that folder, for what Python cannot take; the next start makes a report of it."""
MAX_REPORTS = 20
"""In a sitting: an error in a timer repeats thirty times a second."""


class CrashReporter(QObject):
    """Writes a file for each unexpected error of this process, in any of its threads.

    ``read_log`` returns the event log, which becomes a part of the file.
    """

    reported = Signal(str, str)
    """Kind and sentence for the event log; Qt passes them to the window's thread."""

    def __init__(self, folder: Path, read_log: Callable[[], str]) -> None:
        super().__init__()
        self._folder, self._read_log = folder, read_log
        self._seen: set[str] = set()
        self._native: TextIO | None = None
        """Kept open: faulthandler has its number only."""

    def install(self) -> None:
        """Take the errors that Python would print, of slots and of threads."""
        sys.excepthook = self.take
        threading.excepthook = self._take_of_thread

    def follow_native_code(self) -> None:
        """Report where native code, such as Qt's, ended a window before; note where it ends this.

        A folder that takes no files is told with the settings, which are in it, too.
        """
        path = self._folder / NATIVE
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            if path.exists() and (lines := path.read_text(encoding="utf-8", errors="replace")):
                path.unlink()
                self.reported.emit("failed", self._sentence(lines, "a window before this one"))
            self._native = path.open("a", encoding="utf-8")
            faulthandler.enable(self._native)

    def remove(self) -> None:
        """Leave the errors to Python again."""
        sys.excepthook = sys.__excepthook__
        threading.excepthook = threading.__excepthook__

    def take(
        self, kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        """Write the report of an error and tell where it is; the same error only once."""
        lines = "".join(traceback.format_exception(kind, error, trace))
        print(lines, file=sys.stderr)
        if lines in self._seen or len(self._seen) >= MAX_REPORTS:
            return
        self._seen.add(lines)
        self.reported.emit("failed", self._sentence(lines))

    def _take_of_thread(self, args: threading.ExceptHookArgs) -> None:
        if args.exc_value is not None:
            self.take(args.exc_type, args.exc_value, args.exc_traceback)

    def _sentence(self, lines: str, what: str = "something in the window") -> str:
        try:
            path = self._write(lines)
        except OSError as error:
            return f"{what} failed, and its report could not be written ({error})"
        return f"{what} failed; please send its report to who looks after it: {path}"

    def _write(self, lines: str) -> Path:
        self._folder.mkdir(parents=True, exist_ok=True)
        now = datetime.now().astimezone()
        path = self._folder / f"rigctl-crash-{now:%Y%m%d-%H%M%S}-{len(self._seen)}.txt"
        log = self._read_log() if threading.current_thread() is threading.main_thread() else ""
        parts = (now.isoformat(), "\n".join(version_lines()), lines, "Event log:", log)
        with path.open("x", encoding="utf-8") as file:
            file.write("\n\n".join(parts))
        return path
