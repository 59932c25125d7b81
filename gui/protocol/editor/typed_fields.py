"""Fields that a person types into, whose undo is that of the whole protocol."""

from __future__ import annotations

from PySide6.QtCore import QEvent, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QLineEdit, QPlainTextEdit

_LINES, _FRAME_PX = 4, 12


class TypedLine(QLineEdit):
    """A line."""

    undo_requested = Signal()
    redo_requested = Signal()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass undo and redo on."""
        if not _pass_undo(self, event):
            super().keyPressEvent(event)


class TypedLines(QPlainTextEdit):
    """A text of several lines; Tab leaves it."""

    edited = Signal()
    left = Signal()
    """The focus went elsewhere."""
    undo_requested = Signal()
    redo_requested = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setUndoRedoEnabled(False)
        self.textChanged.connect(self.edited)
        self._set_height()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pass undo and redo on."""
        if not _pass_undo(self, event):
            super().keyPressEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        """Keep the number of lines with texts of another size."""
        super().changeEvent(event)
        if event.type() in (QEvent.Type.FontChange, QEvent.Type.StyleChange):
            self._set_height()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Tell that the text is complete."""
        super().focusOutEvent(event)
        self.left.emit()

    def _set_height(self) -> None:
        self.setFixedHeight(_LINES * self.fontMetrics().lineSpacing() + _FRAME_PX)


def _pass_undo(field: TypedLine | TypedLines, event: QKeyEvent) -> bool:
    """Ask for undo or redo if the keys are theirs; return whether they are."""
    if event.matches(QKeySequence.StandardKey.Undo):
        field.undo_requested.emit()
    elif event.matches(QKeySequence.StandardKey.Redo):
        field.redo_requested.emit()
    else:
        return False
    return True
