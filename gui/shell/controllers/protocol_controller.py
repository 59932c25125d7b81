"""What the window remembers of the Protocol panel for its next start."""

from __future__ import annotations

from PySide6.QtCore import QObject

from gui.protocol.protocol_form import REMEMBERED
from gui.protocol.protocol_panel import ProtocolPanel
from gui.shell.memory.user_settings import UserSettings


class ProtocolController(QObject):
    """Fills in folder, operator and sensor of the last time, and remembers those of this one."""

    def __init__(self, panel: ProtocolPanel, settings: UserSettings) -> None:
        super().__init__()
        self._form = panel.form
        self._settings = settings
        self._form.restore({name: settings.value(_key(name), "") for name in REMEMBERED})
        panel.command_requested.connect(self._remember)

    def _remember(self, command: str) -> None:
        """Remember the fields with which a run starts."""
        if command == "start":
            for name, text in self._form.remembered().items():
                self._settings.set_value(_key(name), text)


def _key(name: str) -> str:
    return f"protocol/{name}"
