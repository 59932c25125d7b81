"""The free steps of a protocol: a list, and the keys of the chosen one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QGroupBox, QListWidget

from gui.protocol.editor.key_row import KeyRow, key_grid
from gui.widgets.layouts import hbox, push_button, vbox
from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_bounds import KeyPath
from rigctl.config.toml_field import FieldType
from rigctl.protocol.fields import EVERY, KIND, PLACE, STEP_KINDS, step_fields
from rigctl.protocol.form_content import FormContent
from rigctl.protocol.typed_values import typed_of

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
        self.every = KeyRow(EVERY, ())
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
        yield from (self.at, self.every, self.kind)
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
        every = f" {typed_of(self._written(place, 'trials'))} trials" if at == "every" else ""
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
            row.show_value(self._content.values.get(row.path), self._mistake(row.path))
        is_chosen = place >= 0
        for row in (self.at, self.kind):
            row.set_visible(is_chosen)
        self.every.set_visible(is_chosen and at == "every")
        for name, rows in self.of_kind.items():
            for row in rows:
                row.set_visible(is_chosen and name == kind)
        if is_chosen and kind in STEP_KINDS and not self.kind.mistake:
            self.kind.note.setText(STEP_KINDS[kind].replace("`", ""))
        self.buttons["Remove"].setEnabled(is_chosen)
        self.buttons["Up"].setEnabled(place > 0)
        self.buttons["Down"].setEnabled(0 <= place < count - 1)

    def _mistake(self, path: KeyPath) -> str:
        return self._content.mistakes.get(path, "")

    def _edit(self, path: KeyPath, value: Any) -> None:
        """Change a key; another place or kind leaves out what belongs to the one before."""
        place, key = self.place, path[-1]
        edits: list[tuple[KeyPath, Any]] = [(path, value)]
        if key == "at" and self._written(place, "trials") is not None and value != "every":
            edits.append(((NAME, place, "trials"), None))
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
