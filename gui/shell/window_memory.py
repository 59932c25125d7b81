"""What the window remembers from one start to the next: layout, fields, recent paths."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

from PySide6.QtCore import QByteArray, QObject, QTimer, Signal
from PySide6.QtWidgets import QLineEdit, QMenu, QWidget

from gui.live.live_page import LivePage
from gui.live.navigation import SPANS_S
from gui.operate.connection_bar import Toolbar
from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea
from gui.shell.user_settings import MAX_LETTERS, UserSettings
from gui.widgets.number_box import NumberBox


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


SAVE_MS = 5000
"""A crash loses at most the changes of this time."""
SPAN_KEY = "span_s"
_Value = TypeVar("_Value", str, float, bool)


class WindowMemory(QObject):
    """Keeps what the user arranged, every few seconds and when the window closes."""

    def __init__(self, settings: UserSettings, window: QWidget, docks: DockArea) -> None:
        super().__init__(window)
        self._settings, self._window, self._docks = settings, window, docks
        self._kept: dict[str, Callable[[], str | float | bool]] = {}
        self._timer = QTimer(self, interval=SAVE_MS)
        self._timer.timeout.connect(self.save)

    def keep_number(self, key: str, box: NumberBox) -> None:
        """Restore a number, and remember it from now on."""
        self._keep(key, box.value, box.setValue, lambda n: box.minimum() <= n <= box.maximum())

    def keep_folders(self, **fields: QLineEdit) -> None:
        """Restore the folders of fields by their keys, and remember them from now on."""
        for key, field in fields.items():
            self._keep(key, field.text, field.setText, lambda text: len(text) <= MAX_LETTERS)

    def keep_live_views(self, page: LivePage) -> None:
        """Restore time span, unit of the readings and unit of the rates, and remember them."""
        navigation, unit = page.plots.navigation, page.bar.unit
        per_mm = page.encoder_strip.per_mm
        self._keep(SPAN_KEY, lambda: navigation.live_span_s, navigation.set_span, is_span)
        self._keep("unit", unit.currentText, unit.setCurrentText, lambda t: unit.findText(t) >= 0)
        self._keep("rates_per_mm", per_mm.isChecked, per_mm.setChecked, lambda _: True)

    def restore_layout(self) -> None:
        """Restore size and docks, and begin to remember changes."""
        if geometry := self._bytes("window"):
            self._window.restoreGeometry(QByteArray(geometry))
        if layout := self._bytes("docks"):
            self._docks.restore(layout)
        self._timer.start()

    def close(self) -> None:
        """Remember everything for the last time."""
        self._timer.stop()
        self.save()

    def save(self) -> None:
        """Remember everything now."""
        settings = self._settings
        settings.set_value("window", b64encode(bytes(self._window.saveGeometry().data())).decode())
        settings.set_value("docks", b64encode(self._docks.save()).decode())
        for key, read in self._kept.items():
            settings.set_value(key, read())
        settings.write()

    def _keep(
        self,
        key: str,
        read: Callable[[], _Value],
        write: Callable[[_Value], object],
        fits: Callable[[_Value], bool],
    ) -> None:
        write(self._settings.value(key, read(), fits))
        self._kept[key] = read

    def _bytes(self, key: str) -> bytes:
        try:
            return b64decode(self._settings.value(key, "", lambda text: True), validate=True)
        except ValueError:
            return b""


def is_span(span_s: float) -> bool:
    """Return whether the menus offer a time span."""
    return span_s in SPANS_S
