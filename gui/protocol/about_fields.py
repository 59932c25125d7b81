"""What people say of a session at its start: a field each, stored with it, offered for the next."""

from __future__ import annotations

from PySide6.QtWidgets import QLineEdit

from gui.widgets.formatting import capitalised
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
