"""Boxes for numbers, which keep what is typed until it is a number, and say why it is none."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QEvent, QPoint, Qt, Signal
from PySide6.QtGui import QHideEvent, QValidator
from PySide6.QtWidgets import QDoubleSpinBox, QFrame, QLabel, QWidget

from gui.widgets.layouts import EventWatch
from gui.widgets.theme import scaled_px
from rigctl.config.typed_number import number_in_steps
from rigctl.errors import WrongUse

_NOTE_PX, _NOTE_ROOM_PX = 280, 120
_UNFINISHED = ("", "-", "+", "−", ".", ",")


class NumberBox(QDoubleSpinBox):
    """A number, with "." or "," as its decimal mark in every language of the computer.

    A text that is no number within the range stays as it is typed, below it stands why it is
    refused, and the value is still the last one. Qt's own box leaves out the keys that do not fit:
    "12,5" would become 125.
    """

    refusal_changed = Signal()
    _refused: str | None = None
    """The refused text; None while the text is a number. Qt asks for texts in its constructor."""
    _refusal = ""
    _note: _Note | None = None

    def __init__(self, **properties: Any) -> None:
        super().__init__(**properties)
        self.lineEdit().textEdited.connect(self._follow_typing)
        self.editingFinished.connect(self.show_refusal)
        EventWatch(self, self._follow, QEvent.Type.Move, QEvent.Type.Resize)
        EventWatch(self, self.show_refusal, QEvent.Type.Show)
        EventWatch(self, self._hide_note, QEvent.Type.Hide)

    @property
    def refusal(self) -> str:
        """Why the text is refused; empty for a number."""
        return self._refusal if self._refused is not None else ""

    def setValue(self, value: float) -> None:
        """Show another value instead of whatever is typed."""
        self._refused = None
        super().setValue(value)
        self.show_refusal()

    def validate(self, text: str, position: int) -> tuple[QValidator.State, str, int]:
        """Accept numbers within the range; refuse no key, so that no text becomes another one."""
        typed = text.removeprefix(self.prefix()).removesuffix(self.suffix())
        was_refused = self._refused is not None
        try:
            self._read(typed)
            self._refused = None
        except WrongUse as error:
            self._refusal, self._refused = str(error), typed
        if was_refused != (self._refused is not None):
            self.refusal_changed.emit()
        is_number = self._refused is None
        state = QValidator.State.Acceptable if is_number else QValidator.State.Intermediate
        return state, text, position

    def fixup(self, text: str) -> str:
        """Leave a refused text alone; Qt's own box takes the language's group marks out of it."""
        return text

    def valueFromText(self, text: str) -> float:
        """Return the number that is typed."""
        return self._read(text.removeprefix(self.prefix()).removesuffix(self.suffix()))

    def textFromValue(self, value: float) -> str:
        """Return the value's text, or a refused text as it is typed."""
        return f"{value:.{self.decimals()}f}" if self._refused is None else self._refused

    def show_refusal(self) -> None:
        """Show why the text is refused, below the box; nothing for a number."""
        if not self.refusal:
            self._hide_note()
            return
        if self._note is None:
            self._note = _Note(self)
        self._note.show_text(self.refusal)

    def _read(self, typed: str) -> float:
        """Return the number that is typed. Raises WrongUse."""
        value = float(number_in_steps(typed, self.decimals()))
        if not self.minimum() <= value <= self.maximum():
            low, high = self._short(self.minimum()), self._short(self.maximum())
            raise WrongUse(f"{typed.strip()} is outside {low} to {high}{self.suffix()}")
        return value

    def _short(self, value: float) -> str:
        text = f"{value:.{self.decimals()}f}"
        return text.rstrip("0").rstrip(".") if self.decimals() else text

    def _follow_typing(self, text: str) -> None:
        """Say at once what more keys cannot mend, and the rest when the person has finished."""
        typed = text.removeprefix(self.prefix()).removesuffix(self.suffix()).strip()
        is_shown = self._note is not None and self._note.isVisible()
        if is_shown or not (typed in _UNFINISHED or self._may_become_larger(typed)):
            self.show_refusal()

    def _may_become_larger(self, typed: str) -> bool:
        try:
            return 0 <= number_in_steps(typed, self.decimals()) < self.minimum()
        except WrongUse:
            return False

    def _hide_note(self) -> None:
        if self._note is not None:
            self._note.hide()

    def _follow(self) -> None:
        if self._note is not None and self._note.isVisible():
            self._note.place()


class WholeNumberBox(NumberBox):
    """A whole number."""

    def __init__(self, **properties: Any) -> None:
        super().__init__(decimals=0, **properties)

    def value(self) -> int:
        """Return the number."""
        return round(super().value())


def has_refused(*boxes: NumberBox) -> bool:
    """Return whether a box has a refused text; the first such box then says why, with the focus."""
    for box in boxes:
        if box.refusal:
            box.setFocus()
            box.show_refusal()
            return True
    return False


class _Note(QLabel):
    """A sentence on the panel of a box, below it or above."""

    def __init__(self, box: QWidget) -> None:
        panel, above = box, box.parentWidget()
        while above is not None and panel.height() < scaled_px(_NOTE_ROOM_PX):
            panel, above = above, above.parentWidget()
        super().__init__(panel, wordWrap=True)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setProperty("role", "refusal")
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._box, self._panel = box, panel

    def show_text(self, text: str) -> None:
        """Show a sentence."""
        self.setText(text)
        self._box.setAccessibleDescription(text)
        self.ensurePolished()  # the style's margins count for the height
        self.place()
        self.show()
        self.raise_()

    def hideEvent(self, event: QHideEvent) -> None:
        """Leave the box without a description."""
        self._box.setAccessibleDescription("")
        super().hideEvent(event)

    def place(self) -> None:
        """Move to the box, within its panel."""
        width = min(scaled_px(_NOTE_PX), self._panel.width())
        height = self.heightForWidth(width)
        at = self._box.mapTo(self._panel, QPoint(0, self._box.height()))
        fits = at.y() + height <= self._panel.height()
        top = at.y() if fits else at.y() - self._box.height() - height
        self.setGeometry(min(at.x(), self._panel.width() - width), max(0, top), width, height)
