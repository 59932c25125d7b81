"""The sessions and the rigs that were opened last, each in a menu."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QMenu

from gui.operate.connection_bar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.user_settings import UserSettings


class RecentPaths(QObject):
    """Remembers paths under a key and lists them in a menu."""

    open_requested = Signal(str)
    """The path of a line that was chosen."""

    def __init__(self, menu: QMenu, settings: UserSettings, key: str) -> None:
        super().__init__()
        self.menu, self._settings, self._key = menu, settings, key
        self.menu.aboutToShow.connect(self._list)

    def remember(self, path: str) -> None:
        """Put a path at the front."""
        if path.strip():
            self._settings.add_recent(self._key, str(Path(path).absolute()))

    def newest(self) -> str:
        """Return the path at the front, empty without any."""
        return next(iter(self._settings.recent(self._key)), "")

    def _list(self) -> None:
        self.menu.clear()
        for path in self._settings.recent(self._key):
            action = self.menu.addAction(path.replace("&", "&&"))
            action.triggered.connect(partial(self._open, path))
        if self.menu.isEmpty():
            self.menu.addAction("(none yet)").setEnabled(False)

    def _open(self, path: str, _: bool = False) -> None:
        self.open_requested.emit(path)


class RecentSessions(RecentPaths):
    """The sessions in the File menu: open one by its folder, or one of the last."""

    browse_requested = Signal()

    def __init__(self, menus: ActionRegistry, settings: UserSettings) -> None:
        tip = "Choose a session folder for the Analysis panel"
        menus.add("File", "&Open a session …", self._browse, shortcut="Ctrl+O", tip=tip)
        super().__init__(menus.add_menu("File", "&Recent sessions"), settings, "sessions")

    def _browse(self) -> None:
        self.browse_requested.emit()


class RecentRigs(RecentPaths):
    """The rig files in the Rig menu that were connected last; choosing one connects nothing."""

    def __init__(self, menus: ActionRegistry, settings: UserSettings, toolbar: Toolbar) -> None:
        super().__init__(menus.add_menu("Rig", "Re&cent rigs"), settings, "rigs")
        self._toolbar = toolbar
        toolbar.connect_requested.connect(lambda rig, _: self._remember_file(rig))
        self.open_requested.connect(self._choose)

    def _remember_file(self, rig: str) -> None:
        if rig.endswith(".toml"):
            self.remember(rig)

    def _choose(self, path: str) -> None:
        """Choose a rig in the list, which is locked while another one is connected."""
        if self._toolbar.rig.isEnabled():
            self._toolbar.rig.choose(path)
