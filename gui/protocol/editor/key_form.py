"""The keys of a protocol as a form, made from their declarations."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from gui.protocol.editor.key_row import KeyRow, key_grid
from gui.protocol.editor.steps_box import StepsBox
from gui.widgets.labels import label
from gui.widgets.layouts import group_box, vbox
from rigctl.config.rig_config import RigConfig
from rigctl.config.toml_bounds import KeyPath
from rigctl.config.toml_field import TomlField
from rigctl.protocol.fields import FieldGroup
from rigctl.protocol.form_content import FormContent, groups_of


class KeyForm(QWidget):
    """Edits the keys of a protocol of the drum, or of the moving finger."""

    edited = Signal(list)
    """Pairs of path and value, None to leave a key out."""
    undo_requested = Signal()
    redo_requested = Signal()

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
        for row in (*self.rows.values(), *self.steps.rows()):
            row.undo_requested.connect(self.undo_requested)
            row.redo_requested.connect(self.redo_requested)

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
