"""The keys of a protocol as a form: a row for each key, and a list for the free steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from PySide6.QtCore import QEvent, QObject, QSignalBlocker, Signal
from PySide6.QtGui import QKeyEvent, QKeySequence
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QGroupBox,
    QLineEdit,
    QListWidget,
    QPlainTextEdit,
    QWidget,
)

from gui.widgets.labels import label, plain_tooltip, set_property
from gui.widgets.layouts import combo_box, group_box, hbox, push_button, vbox
from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_reader import FieldType, KeyPath, TomlField
from rigctl.protocol.fields import (
    KIND,
    OF_PLACE,
    PLACE,
    STEP_KINDS,
    FieldGroup,
    default_of,
    help_of,
    step_fields,
    typed_of,
    value_of,
)
from rigctl.protocol.form_content import FormContent, groups_of

_LINES, _FRAME_PX = 4, 12
_NEW_LOOKS = (QEvent.Type.FontChange, QEvent.Type.StyleChange)


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
        self.field.installEventFilter(self)
        self.set_item(item)
        self.field.setMinimumWidth(_FIELD_PX)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Leave undo and redo to the editor: form and text have one history.

        A field of several lines keeps their number with other texts, and tells when it is left.
        """
        if isinstance(watched, QPlainTextEdit):
            if event.type() in _NEW_LOOKS:
                _set_height(watched)
            elif event.type() == QEvent.Type.FocusOut:
                self._leave_out_if_empty()
        keys = QKeySequence.StandardKey
        if event.type() != QEvent.Type.ShortcutOverride or not isinstance(event, QKeyEvent):
            return False
        if not (event.matches(keys.Undo) or event.matches(keys.Redo)):
            return False
        event.ignore()  # the field would take them
        return True

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
            choices = combo_box({word: word for word in self.item.choices})
            choices.currentTextChanged.connect(self._emit)
            return choices
        if self.item.has_lines:
            return self._make_lines()
        line = QLineEdit()
        line.setPlaceholderText(default_of(self.item))
        line.textEdited.connect(lambda typed: self._emit(value_of(self.item, typed)))
        line.editingFinished.connect(self._leave_out_if_empty)
        return line

    def _make_lines(self) -> QWidget:
        lines = QPlainTextEdit(tabChangesFocus=True, undoRedoEnabled=False)
        lines.setPlaceholderText(default_of(self.item))
        lines.textChanged.connect(lambda: self._emit(value_of(self.item, lines.toPlainText())))
        _set_height(lines)
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
        elif isinstance(self.field, QPlainTextEdit) and self._differs(
            self.field.toPlainText(), written
        ):
            self.field.setPlainText(typed_of(written))

    def _differs(self, typed: str, written: Any) -> bool:
        """Return whether a field has another value than the text."""
        if written is None:
            return bool(typed.strip())
        return bool(value_of(self.item, typed) != written)


def _set_height(lines: QPlainTextEdit) -> None:
    lines.setFixedHeight(_LINES * lines.fontMetrics().lineSpacing() + _FRAME_PX)


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


_LIST_PX = 96
NAME = "steps"


class StepsBox(QGroupBox):
    """Adds, removes, moves and edits free steps."""

    edited = Signal(list)
    """Pairs of path and value, None to leave a key out."""
    insert_requested = Signal(int)
    remove_requested = Signal(int)
    swap_requested = Signal(int)
    """The step at this place goes behind the next one."""

    def __init__(self) -> None:
        super().__init__("Steps")
        self._content = FormContent()
        self.list = QListWidget()
        self.list.setFixedHeight(_LIST_PX)
        self.buttons = {
            "Add": push_button("Add step", self._add, "Add a step behind the chosen one"),
            "Remove": push_button("Remove step", lambda: self.remove_requested.emit(self.place)),
            "Up": push_button("Step up", lambda: self._move(-1)),
            "Down": push_button("Step down", lambda: self._move(1)),
        }
        self.at, self.kind = KeyRow(PLACE, ()), KeyRow(KIND, ())
        self.of_place = {place: KeyRow(item, ()) for place, item in OF_PLACE.items()}
        self.of_kind = {
            kind: [KeyRow(item, ()) for item in items]
            for kind, items in step_fields(RigConfig()).items()
        }
        self._lay_out()
        self.list.currentRowChanged.connect(lambda _: self._show_step())
        for row in self.rows():
            row.edited.connect(self._edit)
        self._show_step()

    @property
    def place(self) -> int:
        """The place of the chosen step, −1 for none."""
        return self.list.currentRow()

    def rows(self) -> Iterator[KeyRow]:
        """Yield the rows of the chosen step, also those that its kind does not have."""
        yield from (self.at, *self.of_place.values(), self.kind)
        for rows in self.of_kind.values():
            yield from rows

    def set_rig(self, config: RigConfig) -> None:
        """Show the ranges of a rig."""
        for kind, items in step_fields(config).items():
            for row, item in zip(self.of_kind[kind], items, strict=True):
                row.set_item(item)

    def show_content(self, content: FormContent) -> None:
        """Show the steps of a text."""
        self._content = content
        texts = [f"{place + 1}. {self._sentence(place)}" for place in range(content.steps)]
        chosen = self.place
        with QSignalBlocker(self.list):
            while self.list.count() > len(texts):
                self.list.takeItem(self.list.count() - 1)
            for place, text in enumerate(texts):
                if place >= self.list.count():
                    self.list.addItem(text)
                self.list.item(place).setText(text)
            self.list.setCurrentRow(min(max(chosen, 0), len(texts) - 1))
        self._show_step()

    def choose(self, place: int) -> None:
        """Choose another step."""
        self.list.setCurrentRow(place)

    def _sentence(self, place: int) -> str:
        """Return when a step runs and what it does, with the values of its keys."""
        at, kind = self._written(place, "at"), self._written(place, "kind")
        own = self.of_place.get(at) if isinstance(at, str) else None
        amount = "" if own is None else f" {self._words(place, own)}"
        every = f"{amount} trials" if at == "every" else amount
        rows = self.of_kind.get(kind, ()) if isinstance(kind, str) else ()
        words = ", ".join(filter(None, (self._words(place, row) for row in rows)))
        return f"{typed_of(at)}{every}: {typed_of(kind)} {words}".strip()

    def _words(self, place: int, row: KeyRow) -> str:
        """Return the value of a key with its unit; a flag that is set by its name."""
        written = self._written(place, row.item.key)
        if row.item.type is FieldType.FLAG:
            return row.item.key if written is True else ""
        return f"{typed_of(written)} {row.item.unit}".strip() if written is not None else ""

    def _written(self, place: int, key: str) -> Any:
        return self._content.values.get((NAME, place, key))

    def _show_step(self) -> None:
        place, count = self.place, self._content.steps
        at, kind = self._written(place, "at"), self._written(place, "kind")
        for row in self.rows():
            row.path = (NAME, place, row.item.key)
            mistake = self._content.mistakes.get(row.path, "")
            row.show_value(self._content.values.get(row.path), mistake)
        is_chosen = place >= 0
        for row in (self.at, self.kind):
            row.set_visible(is_chosen)
        for name, row in self.of_place.items():
            row.set_visible(is_chosen and at == name)
        for name, rows in self.of_kind.items():
            for row in rows:
                row.set_visible(is_chosen and name == kind)
        if is_chosen and kind in STEP_KINDS and not self.kind.mistake:
            self.kind.note.setText(STEP_KINDS[kind].replace("`", ""))
        self.buttons["Remove"].setEnabled(is_chosen)
        self.buttons["Up"].setEnabled(place > 0)
        self.buttons["Down"].setEnabled(0 <= place < count - 1)

    def _edit(self, path: KeyPath, value: Any) -> None:
        """Change a key; another place or kind leaves out what belongs to the one before."""
        place, key = self.place, path[-1]
        edits: list[tuple[KeyPath, Any]] = [(path, value)]
        if key == "at":
            others = [row.item.key for name, row in self.of_place.items() if name != value]
            edits += [((NAME, place, other), None) for other in others
                      if self._written(place, other) is not None]  # fmt: skip
        if key == "kind":
            kept = {row.item.key for row in self.of_kind[value]}
            known = {row.item.key for rows in self.of_kind.values() for row in rows}
            edits += [((NAME, place, other), None) for other in sorted(known - kept)
                      if self._written(place, other) is not None]  # fmt: skip
        self.edited.emit(edits)

    def _add(self) -> None:
        self.insert_requested.emit(self.place + 1)
        self.choose(self.place + 1)

    def _move(self, by: int) -> None:
        place = self.place
        self.swap_requested.emit(place if by > 0 else place - 1)
        self.choose(place + by)

    def _lay_out(self) -> None:
        grid = key_grid()
        for row in self.rows():
            row.add_to(grid)
        column = vbox(
            self.list, hbox(*self.buttons.values()), grid, spacing=4, margins=(8, 6, 8, 8)
        )
        self.setLayout(column)


class KeyForm(QWidget):
    """Edits the keys of a protocol of the drum, or of the moving finger."""

    edited = Signal(list)
    """Pairs of path and value, None to leave a key out."""

    def __init__(self, *, is_finger: bool) -> None:
        super().__init__()
        self.rows: dict[KeyPath, KeyRow] = {}
        self._content = FormContent()
        self._column = vbox(spacing=4, margins=(2, 2, 6, 2))
        for group in groups_of(RigConfig(), is_finger=is_finger):
            self._column.addWidget(self._box(group))
        self.steps = StepsBox()
        self.steps.setVisible(not is_finger)
        self._column.addWidget(self.steps)
        self._column.addStretch(1)
        self.setLayout(self._column)
        self.steps.edited.connect(self.edited)

    def set_rig(self, config: RigConfig) -> None:
        """Show the ranges of a rig."""
        for group in groups_of(config, is_finger=False):
            for item in group.fields:
                self.rows[_path(group, item)].set_item(item)
        self.steps.set_rig(config)

    def show_content(self, content: FormContent) -> None:
        """Show the values of a text."""
        self._content = content
        for path, row in self.rows.items():
            row.show_value(content.values.get(path), content.mistakes.get(path, ""))
        self.steps.show_content(content)

    def show_mistakes(self, found: Mapping[KeyPath, str]) -> None:
        """Show what the check of the whole protocol found, beside the mistakes of each value."""
        mistakes = {**found, **self._content.mistakes}
        for row in (*self.rows.values(), *self.steps.rows()):
            row.show_mistake(mistakes.get(row.path, ""))

    def _box(self, group: FieldGroup) -> QWidget:
        box, column = group_box(group.title, vbox(spacing=4))
        if group.doc:
            column.addWidget(label(group.doc, "muted", wraps=True))
        grid = key_grid()
        for item in group.fields:
            path = _path(group, item)
            row = self.rows[path] = KeyRow(item, path)
            row.edited.connect(lambda path, value: self.edited.emit([(path, value)]))
            row.add_to(grid)
        column.addLayout(grid)
        return box


def _path(group: FieldGroup, item: TomlField) -> KeyPath:
    return (group.table, item.key) if group.table else (item.key,)
