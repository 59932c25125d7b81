"""What the window remembers for a user: layout, theme, set-points, recent files."""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TypeVar
from unicodedata import category

from PySide6.QtCore import QByteArray, QObject, QSettings, QTimer, Signal
from PySide6.QtWidgets import QComboBox, QLineEdit, QMenu, QWidget

from gui.live.live_page import LivePage
from gui.live.navigation import SPANS_S
from gui.operate.connection_bar import Toolbar
from gui.protocol.about_fields import OwnFields
from gui.shell.actions import ActionRegistry
from gui.shell.docks import DockArea
from gui.widgets.number_box import NumberBox
from rigctl.config.text_file import is_plain_file

MAX_RECENT = 8
MAX_LETTERS = 4096
"""No path of a file is longer."""
_Value = TypeVar("_Value", str, int, float, bool, list[str])


class UserSettings:
    """Values by key, in an ini file of :class:`QSettings`; ``path=None`` remembers nothing.

    A damaged file is moved aside, a damaged value is replaced by its default; :meth:`complaint`
    tells about both once.
    """

    def __init__(self, path: Path | None) -> None:
        self._values: dict[str, str] = {}
        self._complaints: list[str] = []
        self._file: QSettings | None = None
        self.is_first = path is not None and not path.exists()
        """Whether the user had no settings yet, not even damaged ones."""
        if path is not None:
            self._file = self._open(path)

    @classmethod
    def of_user(cls) -> UserSettings:
        """Return the settings of the user who runs the window."""
        scope = QSettings.Scope.UserScope
        file = QSettings(QSettings.Format.IniFormat, scope, "rigctl", "window")
        return cls(Path(file.fileName()))

    @property
    def folder(self) -> Path:
        """Folder of the file, the home folder without one."""
        return Path(self._file.fileName()).parent if self._file is not None else Path.home()

    def value(
        self, key: str, default: _Value, fits: Callable[[_Value], bool] | None = None
    ) -> _Value:
        """Return the value of a key, or the default if there is none of its type that ``fits``."""
        text = self._read(key)
        if text is None:
            return default
        value = None
        with suppress(ValueError, RecursionError, OverflowError):
            value = json.loads(text)
            if isinstance(default, float) and type(value) is int:
                value = float(value)
        if type(value) is type(default) and _is_plain(value) and (fits is None or fits(value)):
            return value
        self._complaints.append(f"the setting {key!r} is damaged: its default is used")
        self._forget(key)
        return default

    def set_value(self, key: str, value: str | float | bool | list[str]) -> None:
        """Remember a value."""
        text = json.dumps(value)
        if self._file is None:
            self._values[key] = text
        else:
            self._file.setValue(key, text)

    def recent(self, key: str) -> list[str]:
        """Return the recent texts of a key, such as paths of sessions, newest first."""
        return self.value(key, list[str]())

    def add_recent(self, key: str, text: str) -> None:
        """Put a text at the front of the recent ones, unless a menu could not show it."""
        self.write()  # takes over those of other windows
        if _is_plain([text]):
            others = (other for other in self.recent(key) if other != text)
            self.set_value(key, [text, *others][:MAX_RECENT])

    def write(self) -> None:
        """Write changes to the file now, which a crash then keeps, and read those of others."""
        if self._file is not None:
            self._file.sync()

    def complaint(self) -> str:
        """Return a sentence about what was damaged since the last call, empty if nothing was."""
        found, self._complaints = self._complaints, []
        return "; ".join(dict.fromkeys(found))

    def _open(self, path: Path) -> QSettings:
        file = QSettings(str(path), QSettings.Format.IniFormat)
        if file.status() is QSettings.Status.FormatError or not _is_text(path):
            aside = path.with_name(f"{path.name}.damaged")
            self._complaints.append(
                f"the settings in {path} are damaged: they are now {aside.name}, "
                "and the window starts with its defaults"
            )
            with suppress(OSError):
                path.replace(aside)
            file = QSettings(str(path), QSettings.Format.IniFormat)
        if not file.isWritable():
            self._complaints.append(
                f"the settings in {path} cannot be written: this window forgets its layout and "
                "its choices; allow writing there"
            )
        return file

    def _read(self, key: str) -> str | None:
        if self._file is None:
            return self._values.get(key)
        value = self._file.value(key)
        return value if isinstance(value, str) or value is None else str(value)

    def _forget(self, key: str) -> None:
        self._values.pop(key, None)
        if self._file is not None:
            self._file.remove(key)


def _is_text(path: Path) -> bool:
    """Return whether a file is text, or is not there; Qt reads any bytes."""
    try:
        return "\0" not in path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return False
    except OSError:
        return True


def _is_plain(value: object) -> bool:
    """Return whether every text in a value can be shown: no control characters, no half ones."""
    if isinstance(value, list):
        return all(isinstance(item, str) and len(item) <= MAX_LETTERS for item in value) and all(
            _is_plain(item) for item in value
        )
    return not isinstance(value, str) or all(
        category(letter) not in ("Cc", "Cs") for letter in value
    )


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
        menus.add(
            "File",
            "&Open a session …",
            lambda: self.browse_requested.emit(),
            shortcut="Ctrl+O",
            tip=tip,
        )
        super().__init__(menus.add_menu("File", "&Recent sessions"), settings, "sessions")


class RecentRigs(RecentPaths):
    """The rig files in the Rig menu that were connected last; choosing one connects nothing."""

    def __init__(self, menus: ActionRegistry, settings: UserSettings, toolbar: Toolbar) -> None:
        super().__init__(menus.add_menu("Rig", "Re&cent rigs"), settings, "rigs")
        self._toolbar = toolbar
        self.open_requested.connect(self._choose)

    def remember_connected(self) -> None:
        """Remember the rig that is connected now, if it is a file's."""
        rig = str(self._toolbar.rig.currentData() or "")
        if rig.endswith(".toml"):
            self.remember(rig)

    def _choose(self, path: str) -> None:
        """Choose a rig in the list, which is locked while another one is connected."""
        if self._toolbar.rig.isEnabled():
            self._toolbar.rig.choose(path)


SAVE_MS = 5000
"""A crash loses at most the changes of this time."""
SPAN_KEY = "span_s"
_Kept = TypeVar("_Kept", str, float, bool, list[str])


class WindowMemory(QObject):
    """Keeps what the user arranged, every few seconds and when the window closes."""

    def __init__(self, settings: UserSettings, window: QWidget, docks: DockArea) -> None:
        super().__init__(window)
        self._settings, self._window, self._docks = settings, window, docks
        self._kept: dict[str, Callable[[], str | float | bool | list[str]]] = {}
        self._saved: dict[str, str | float | bool | list[str]] = {}
        self._timer = QTimer(self, interval=SAVE_MS)
        self._timer.timeout.connect(self.save)

    def keep_number(self, key: str, box: NumberBox) -> None:
        """Restore a number, and remember it from now on."""
        self._keep(key, box.value, box.setValue, lambda n: box.minimum() <= n <= box.maximum())

    def keep_texts(self, fields: Mapping[str, QLineEdit | OwnFields]) -> None:
        """Restore the texts of fields by their keys, and remember them from now on."""
        for key, field in fields.items():
            self._keep(key, field.text, field.setText, lambda text: len(text) <= MAX_LETTERS)

    def keep_files(self, key: str, box: QComboBox) -> None:
        """List the files that were added to a list, as far as they exist, and remember them."""
        own = box.count()

        def read() -> list[str]:
            return [box.itemData(place) for place in range(own, box.count())]

        def add(paths: list[str]) -> None:
            for path in filter(is_plain_file, map(Path, paths)):
                box.addItem(path.name, str(path))

        self._keep(key, read, add, lambda _: True)

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
            self._saved["window"] = self._geometry()
        if layout := self._bytes("docks"):
            self._docks.restore(layout)
            self._saved["docks"] = self._layout()
        self._timer.start()

    def close(self) -> None:
        """Remember everything for the last time."""
        self._timer.stop()
        self.save()

    def save(self) -> None:
        """Remember everything now."""
        self._save("window", self._geometry())
        self._save("docks", self._layout())
        for key, read in self._kept.items():
            self._save(key, read())
        self._settings.write()

    def _geometry(self) -> str:
        return b64encode(bytes(self._window.window().saveGeometry().data())).decode()

    def _layout(self) -> str:
        return b64encode(self._docks.save()).decode()

    def _save(self, key: str, value: str | float | bool | list[str]) -> None:
        """Remember what was changed in this window: another one may have changed the rest."""
        if self._saved.get(key) != value:
            self._saved[key] = value
            self._settings.set_value(key, value)

    def _keep(
        self,
        key: str,
        read: Callable[[], _Kept],
        write: Callable[[_Kept], object],
        fits: Callable[[_Kept], bool],
    ) -> None:
        write(self._settings.value(key, read(), fits))
        self._kept[key] = read
        self._saved[key] = read()

    def _bytes(self, key: str) -> bytes:
        try:
            return b64decode(self._settings.value(key, "", lambda text: True), validate=True)
        except ValueError:
            return b""


def is_span(span_s: float) -> bool:
    """Return whether the menus offer a time span."""
    return span_s in SPANS_S
