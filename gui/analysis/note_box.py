"""A field for a note on the trial in hand, and the mark that takes it out of the analysis."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.widgets.layouts import FlowLayout, push_button
from rigctl.session.notes import MAX_LETTERS, Mark

NO_REASON = "no reason given"
"""The text of a mark that a key sets."""
_LEAST_PX = 120


class NoteBox(QWidget):
    """Emits notes on the trial that its page shows; ``where`` says to what they are bound."""

    written = Signal(str, str)
    """The text, and the mark: bad, good or empty."""

    def __init__(self, where: str, tip: str) -> None:
        super().__init__()
        self.text = QLineEdit(placeholderText=f"Note {where}", maxLength=MAX_LETTERS)
        self.text.setMinimumWidth(_LEAST_PX)
        self.text.setToolTip(tip)
        self.add_button = push_button("Add note", self._add, tip)
        self.mark_button = push_button("Mark bad", self.mark)
        self._marks = Mark.NONE
        self.setLayout(FlowLayout(self.text, self.add_button, self.mark_button))
        self.text.textChanged.connect(lambda _: self._enable())
        self.text.returnPressed.connect(self.add_button.click)
        self.show_trial(Mark.NONE)

    def show_trial(self, marks: Mark, *, has_trial: bool = False) -> None:
        """Offer a note on a trial, and the mark that it can get; none where it has no verdict."""
        self._marks, self._has_trial = marks, has_trial
        self.mark_button.setText("Mark good" if marks is Mark.GOOD else "Mark bad")
        self._enable()

    def mark(self) -> None:
        """Mark the trial bad, or good where it is marked bad, with the text or without one."""
        if self._marks:
            self.written.emit(self.text.text().strip() or NO_REASON, self._marks.value)
            self.text.clear()

    def _add(self) -> None:
        self.written.emit(self.text.text().strip(), Mark.NONE.value)
        self.text.clear()

    def _enable(self) -> None:
        has_text = bool(self.text.text().strip())
        self.add_button.setEnabled(self._has_trial and has_text)
        self.mark_button.setEnabled(bool(self._marks))
        tips = {Mark.BAD: "It does not count then (Ctrl+B)", Mark.GOOD: "It counts again (Ctrl+B)"}
        self.mark_button.setToolTip(tips.get(self._marks, "Choose a trial that counts"))
