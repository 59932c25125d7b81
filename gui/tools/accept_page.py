"""Accept a rig: judge it by a session of the acceptance protocol, as ``rigctl accept`` does."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QLineEdit

from gui.tools.command_page import CommandPage
from gui.widgets.file_browser import PathKind, browse_button
from gui.widgets.labels import label
from gui.widgets.typed_paths import typed_path


class AcceptPage(CommandPage):
    """Force, drift, speed, steps and losses of a rig, each against its limit."""

    path_requested = Signal(object, object)

    def __init__(self) -> None:
        explanation = (
            "Judges force, drift, speed, steps and losses of a rig by a session that was recorded "
            "with the protocol “acceptance”, as rigctl accept does."
        )
        super().__init__(
            "Accept a rig",
            explanation,
            "Judge the rig",
            words=self._accept_words,
            refusal=self._missing_session,
        )
        self.folder = QLineEdit(placeholderText="Session of the acceptance protocol")
        self.folder.returnPressed.connect(self.run)
        self.add_input(label("Session"))
        self.add_input(self.folder, 1)
        self.add_input(browse_button(self.path_requested, PathKind.SESSION, self.folder.setText))

    def _accept_words(self) -> Sequence[str]:
        return ("accept", "--", str(typed_path(self.folder.text())))

    def _missing_session(self) -> str:
        return "" if self.folder.text().strip() else "Choose the folder of a session first."
