"""One key of a protocol as a row of a form: its name, a field, its unit, and a sentence of help."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QLineEdit,
    QWidget,
)

from gui.protocol.editor.typed_fields import TypedLine, TypedLines
from gui.widgets.focus_wheel import focus_wheel
from gui.widgets.labels import label, plain_tooltip, set_property
from gui.widgets.layouts import combo_box
from rigctl.config.toml_bounds import KeyPath
from rigctl.config.toml_field import FieldType, TomlField
from rigctl.protocol.typed_values import default_of, help_of, typed_of, value_of

_UNITS = {
    "mm/s": "_mm_s",
    "mm": "_mm",
    "g": "_g",
    "s": "_s",
    "%": "_percent",
    "ms": "_ms",
    "Hz": "_hz",
}
_FIELD_PX = 150


class KeyRow(QObject):
    """Shows and edits the key at ``path``, which the owner of a repeated table changes."""

    edited = Signal(object, object)
    """Path and value; None leaves the key out."""
    undo_requested = Signal()
    redo_requested = Signal()

    def __init__(self, item: TomlField, path: KeyPath) -> None:
        super().__init__()
        self.item, self.path = item, path
        self._written: Any = None
        self._is_emptied = False
        """Whether a person has emptied the field."""
        self.name, self.unit = label(title_of(item)), label(item.unit, "muted")
        self.note = label("", "muted", wraps=True)
        self.field = self._make_field()
        self.field.setAccessibleName(title_of(item))
        self.set_item(item)
        self.field.setMinimumWidth(_FIELD_PX)

    @property
    def mistake(self) -> str:
        """What is wrong with the value; empty for nothing."""
        return self.note.text() if self.note.property("role") == "bad" else ""

    def add_to(self, grid: QGridLayout) -> None:
        """Add the row below the others."""
        row = grid.rowCount()
        for column, widget in enumerate((self.name, self.field, self.unit, self.note)):
            grid.addWidget(widget, row, column)

    def set_visible(self, is_visible: bool) -> None:
        """Show or hide the row."""
        for widget in (self.name, self.field, self.unit, self.note):
            widget.setVisible(is_visible)

    def set_item(self, item: TomlField) -> None:
        """Take the same key with the range of another rig."""
        mistake, self.item = self.mistake, item
        self.name.setToolTip(f"{item.key}, default: {default_of(item)}")
        self.field.setAccessibleDescription(help_of(item))
        self.show_mistake(mistake)

    def show_value(self, written: Any, mistake: str) -> None:
        """Show the value that the text has, None if it has none, and what is wrong with it."""
        self._written = written
        with QSignalBlocker(self.field):
            self._show(written)
        self.show_mistake(mistake)

    def show_mistake(self, mistake: str) -> None:
        """Show what is wrong with the value; the help for nothing."""
        text = mistake or help_of(self.item)
        if self.note.text() != text:
            self.note.setText(text)
        set_property(self.note, "role", "bad" if mistake else "muted")
        self.field.setToolTip(plain_tooltip(help_of(self.item) if mistake else ""))

    def _make_field(self) -> QWidget:
        if self.item.type is FieldType.FLAG:
            box = QCheckBox()
            box.toggled.connect(self._emit)
            return box
        if self.item.type is FieldType.CHOICE:
            choices = focus_wheel(combo_box({word: word for word in self.item.choices}))
            choices.currentTextChanged.connect(self._emit)
            return choices
        if self.item.has_lines:
            return self._make_lines()
        line = TypedLine()
        line.setPlaceholderText(default_of(self.item))
        line.textEdited.connect(lambda typed: self._emit(value_of(self.item, typed)))
        line.editingFinished.connect(self._leave_out_if_empty)
        line.undo_requested.connect(self.undo_requested)
        line.redo_requested.connect(self.redo_requested)
        return line

    def _make_lines(self) -> QWidget:
        lines = TypedLines()
        lines.setPlaceholderText(default_of(self.item))
        lines.edited.connect(lambda: self._emit(value_of(self.item, lines.toPlainText())))
        lines.left.connect(self._leave_out_if_empty)
        lines.undo_requested.connect(self.undo_requested)
        lines.redo_requested.connect(self.redo_requested)
        return lines

    def _emit(self, value: Any) -> None:
        self._written, self._is_emptied = value, value in ("", [])
        self.edited.emit(self.path, value)

    def _leave_out_if_empty(self) -> None:
        """Leave an emptied key out; while a person types, its line and comment stay."""
        if self._is_emptied and self._written in ("", []):
            self._emit(None)

    def _show(self, written: Any) -> None:
        shown = self.item.default if written is None else written
        if isinstance(self.field, QCheckBox):
            self.field.setChecked(shown is True)
        elif isinstance(self.field, QComboBox):
            self.field.setCurrentIndex(self.field.findText(typed_of(shown)))
        elif isinstance(self.field, QLineEdit):
            if self._differs(self.field.text(), written):
                self.field.setText(typed_of(written))
                self.field.setCursorPosition(0)
        elif isinstance(self.field, TypedLines) and self._differs(
            self.field.toPlainText(), written
        ):
            self.field.setPlainText(typed_of(written))

    def _differs(self, typed: str, written: Any) -> bool:
        """Return whether a field has another value than the text."""
        if written is None:
            return bool(typed.strip())
        return bool(value_of(self.item, typed) != written)


def title_of(item: TomlField) -> str:
    """Return the name of a key for people, without its unit."""
    if item.title:
        return item.title
    return item.key.removesuffix(_UNITS.get(item.unit, "")).replace("_", " ").capitalize()


def key_grid() -> QGridLayout:
    """Return a grid for rows, whose columns are alike in each box."""
    grid = QGridLayout()
    grid.setHorizontalSpacing(8)
    grid.setVerticalSpacing(4)
    metrics = label().fontMetrics()
    for column, widest in ((0, "Speed tolerance mm"), (2, "mm/s")):
        grid.setColumnMinimumWidth(column, metrics.horizontalAdvance(widest))
    grid.setColumnStretch(1, 3)
    grid.setColumnStretch(3, 4)
    return grid
