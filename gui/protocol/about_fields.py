"""What people say of a session at its start: a field each, stored with it, offered for the next."""

from __future__ import annotations

import json
from collections.abc import Iterable

from PySide6.QtWidgets import QLineEdit, QWidget

from gui.widgets.formatting import capitalised
from gui.widgets.layouts import form_layout
from rigctl.values import ABOUT

MAX_NAME_LETTERS = 200
MAX_NOTE_LETTERS = 2000
_KEPT = "stored with the session, offered for the next"


def about_fields(rig_file: str) -> dict[str, QLineEdit]:
    """Return a field by the session's attribute; ``rig_file`` has what empty ones stand for."""
    fields = {name: QLineEdit(maxLength=MAX_NAME_LETTERS) for name in ABOUT}
    for name, words in ABOUT.items():
        fields[name].setToolTip(f"{capitalised(words)}: {_KEPT}")
    fields["remarks"].setMaxLength(MAX_NOTE_LETTERS)
    for name in ("operator", "sensor"):
        fields[name].setPlaceholderText(f"as in {rig_file}")
    return fields


def about_title(name: str) -> str:
    """Return what stands before a field."""
    return capitalised(name.replace("_", " "))


class OwnFields(QWidget):
    """The fields that a rig's lab asks for itself; what was said of each is offered again."""

    def __init__(self) -> None:
        super().__init__()
        self.fields: dict[str, QLineEdit] = {}
        self._said: dict[str, str] = {}
        self._form = form_layout(4)
        self.setLayout(self._form)
        self.hide()

    def show_asked(self, names: Iterable[str]) -> None:
        """Show a field for each name."""
        if list(names) == list(self.fields):
            return
        while self._form.rowCount():
            self._form.removeRow(0)
        self.fields = {name: QLineEdit(maxLength=MAX_NAME_LETTERS) for name in names}
        for name, field in self.fields.items():
            field.setText(self._said.get(name, ""))
            field.setToolTip(f"Your own field, from about.ask of the rig's file: {_KEPT}")
            field.textChanged.connect(lambda text, name=name: self._said.update({name: text}))
            self._form.addRow(capitalised(name), field)
        self.setVisible(bool(self.fields))

    def said(self) -> dict[str, dict[str, str]]:
        """Return what is said, as an argument of the engine's command start; empty for nothing."""
        own = {name: text for name, field in self.fields.items() if (text := field.text().strip())}
        return {"own": own} if own else {}

    def text(self) -> str:
        """Return everything that was ever said, for the settings."""
        return json.dumps(self._said) if self._said else ""

    def setText(self, text: str) -> None:
        """Take what the settings hold; anything else than texts by name counts as nothing."""
        try:
            found = json.loads(text or "{}")
        except ValueError:
            found = {}
        texts = found.items() if isinstance(found, dict) else ()
        self._said = {name: said for name, said in texts if isinstance(said, str)}
        for name, field in self.fields.items():
            field.setText(self._said.get(name, ""))
