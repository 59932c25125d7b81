"""A protocol as text: edited, checked while it is written, and saved as a file of the user."""

from __future__ import annotations

import re
from pathlib import Path

from PySide6.QtCore import QTimer, Signal
from PySide6.QtGui import QColor, QFontDatabase, QTextCharFormat, QTextCursor, QTextFormat
from PySide6.QtWidgets import QLineEdit, QPlainTextEdit, QTextEdit, QWidget

from gui.protocol.run_values import CheckedText, SavedProtocol
from gui.widgets.labels import label, set_property, show_text
from gui.widgets.layouts import container, hbox, push_button, vbox
from gui.widgets.theme import applied_theme

CHECK_MS = 300
"""From the last key to the check."""
_LINE = re.compile(r"\bline (\d+)")


class ProtocolEditor(QWidget):
    """Edits one protocol. A worker process reads, checks and saves it."""

    check_requested = Signal(str)
    save_requested = Signal(str, str, bool)
    """Path, text, and whether a file of that name may be replaced."""

    def __init__(self) -> None:
        super().__init__()
        self.text = QPlainTextEdit()
        self.text.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.text.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.text.setTabChangesFocus(True)
        self.path = QLineEdit()
        self.path.setToolTip("File of the protocol; one of the program is saved as a new file")
        self.save_button = push_button("Save", self._save)
        self.verdict = label("", wraps=True)
        self.marked_line = 0
        """Number of the line that is marked, from 1; 0 for none."""
        self._own_path = ""
        self._is_good = False
        self._timer = QTimer(self, singleShot=True, interval=CHECK_MS)
        self._timer.timeout.connect(self._check)
        self.text.textChanged.connect(self._on_changed)
        bottom = hbox(label("Save as"), self.path, self.save_button, wide=1, spacing=6)
        column = vbox(self.text, self.verdict, container(bottom), spacing=6)
        column.setStretch(0, 1)
        self.setLayout(column)
        self._enable()

    def show_file(self, path: str, text: str, own_path: str) -> None:
        """Show a protocol; ``own_path``: where it may be saved, elsewhere if built in."""
        self._own_path = path if own_path == path else ""
        self.path.setText(own_path)
        self.text.setPlainText(text)

    def show_check(self, checked: CheckedText) -> None:
        """Show whether the text is a protocol, and mark the line of its first error."""
        if checked.text != self.text.toPlainText():
            return  # of an earlier text
        self._is_good = not checked.problem
        self._show_verdict(checked.problem or checked.summary, is_bad=bool(checked.problem))
        found = _LINE.search(checked.problem)
        self._mark_line(int(found[1]) if found else 0)
        self._enable()

    def show_saved(self, saved: SavedProtocol) -> None:
        """Show that the text was saved, or why not."""
        if not saved.problem:
            self._own_path = saved.path
        self._show_verdict(saved.problem or f"Saved: {saved.path}", is_bad=bool(saved.problem))

    def _on_changed(self) -> None:
        self._is_good = False
        self._enable()
        self._timer.start()

    def _check(self) -> None:
        self.check_requested.emit(self.text.toPlainText())

    def _save(self) -> None:
        path = str(Path(self.path.text().strip()).expanduser())
        self.save_requested.emit(path, self.text.toPlainText(), path == self._own_path)

    def _show_verdict(self, sentence: str, *, is_bad: bool) -> None:
        show_text(self.verdict, sentence)
        set_property(self.verdict, "role", "bad" if is_bad else "")

    def _enable(self) -> None:
        self.save_button.setEnabled(self._is_good)

    def _mark_line(self, number: int) -> None:
        """Mark a line, none for 0."""
        self.marked_line = number
        marks = []
        block = self.text.document().findBlockByNumber(number - 1)
        if number and block.isValid():
            mark = QTextEdit.ExtraSelection()
            line = QTextCharFormat()
            line.setBackground(QColor(applied_theme().bad_back))
            line.setProperty(QTextFormat.Property.FullWidthSelection, True)
            mark.format, mark.cursor = line, QTextCursor(block)
            marks.append(mark)
        self.text.setExtraSelections(marks)
