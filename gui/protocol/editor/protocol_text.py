"""The text of a protocol: the one document that the form and the text view change."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from PySide6.QtGui import QColor, QFontDatabase, QTextCharFormat, QTextCursor, QTextFormat
from PySide6.QtWidgets import QPlainTextEdit, QTextEdit

from gui.widgets.theme import applied_theme


class ProtocolTextEdit(QPlainTextEdit):
    """Edits the text; changes of the form come into the same history of undo."""

    def __init__(self) -> None:
        super().__init__()
        self.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.setTabChangesFocus(True)
        self.marked_line = 0
        """Number of the line that is marked, from 1; 0 for none."""
        self._last: tuple[Hashable, int] = (None, -1)

    def change(self, edited: Callable[[str], str], step: Hashable) -> None:
        """Change the text where ``edited`` returns another one.

        Changes with the same ``step`` directly after each other are undone together.
        """
        before = self.toPlainText()
        after = edited(before)
        if after == before:
            return
        start = _alike(before, after)
        same = _alike(before[start:][::-1], after[start:][::-1])
        cursor = QTextCursor(self.document())
        if self._last == (step, self.document().revision()):
            cursor.joinPreviousEditBlock()
        else:
            cursor.beginEditBlock()
        cursor.setPosition(_units(before[:start]))
        end = _units(before[: len(before) - same])
        cursor.setPosition(end, QTextCursor.MoveMode.KeepAnchor)
        cursor.insertText(after[start : len(after) - same])
        self._last = (step, self.document().revision())
        cursor.endEditBlock()
        self._last = (step, self.document().revision())

    def mark_line(self, number: int) -> None:
        """Mark a line, none for 0."""
        self.marked_line = number
        marks = []
        block = self.document().findBlockByNumber(number - 1)
        if number and block.isValid():
            mark = QTextEdit.ExtraSelection()
            line = QTextCharFormat()
            line.setBackground(QColor(applied_theme().bad_back))
            line.setProperty(QTextFormat.Property.FullWidthSelection, True)
            mark.format, mark.cursor = line, QTextCursor(block)
            marks.append(mark)
        self.setExtraSelections(marks)


def _alike(one: str, other: str) -> int:
    """Return how many letters at the beginning are the same."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((place for place, (a, b) in pairs if a != b), min(len(one), len(other)))


def _units(text: str) -> int:
    """Return the length that Qt counts, in units of UTF-16."""
    return len(text.encode("utf-16-le", "surrogatepass")) // 2
