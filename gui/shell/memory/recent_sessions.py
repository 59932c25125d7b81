"""The sessions in the File menu: open one by its folder, or one of the last."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from gui.shell.actions import ActionRegistry
from gui.shell.memory.user_settings import UserSettings

_KEY = "sessions"


class RecentSessions(QObject):
    """Remembers the sessions that were opened."""

    browse_requested = Signal()
    open_requested = Signal(str)
    """The folder of a session."""

    def __init__(self, menus: ActionRegistry, settings: UserSettings) -> None:
        super().__init__()
        self._settings = settings
        tip = "Choose a session folder for the Analysis panel"
        browse = self.browse_requested.emit
        menus.add("File", "&Open a session …", browse, shortcut="Ctrl+O", tip=tip)
        self.menu = menus.add_menu("File", "&Recent sessions")
        self.menu.aboutToShow.connect(self._list)

    def remember(self, path: str) -> None:
        """Put a session at the front."""
        if path.strip():
            self._settings.add_recent(_KEY, str(Path(path).absolute()))

    def _list(self) -> None:
        self.menu.clear()
        for path in self._settings.recent(_KEY):
            action = self.menu.addAction(path.replace("&", "&&"))
            action.triggered.connect(partial(self._open, path))
        if self.menu.isEmpty():
            self.menu.addAction("(none yet)").setEnabled(False)

    def _open(self, path: str, _: bool = False) -> None:
        self.open_requested.emit(path)
