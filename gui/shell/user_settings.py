"""What the window remembers for a user: layout, theme, set-points, recent files."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar
from unicodedata import category

from PySide6.QtCore import QSettings

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
        if _is_plain([text]):
            others = (other for other in self.recent(key) if other != text)
            self.set_value(key, [text, *others][:MAX_RECENT])

    def write(self) -> None:
        """Write changes to the file now; a crash then loses none of them."""
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
