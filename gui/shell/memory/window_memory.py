"""Layout, theme, set-points and folders that return when the window opens again."""

from __future__ import annotations

from base64 import b64decode, b64encode
from binascii import Error as Base64Error

from PySide6.QtCore import QByteArray, QObject, QTimer
from PySide6.QtWidgets import QDoubleSpinBox, QLineEdit, QWidget

from gui.shell.docks import DockArea
from gui.shell.memory.user_settings import UserSettings

SAVE_MS = 5000
"""A crash loses at most the changes of this time."""


class WindowMemory(QObject):
    """Keeps what the user arranged, every few seconds and when the window closes."""

    def __init__(self, settings: UserSettings, window: QWidget, docks: DockArea) -> None:
        super().__init__(window)
        self._settings, self._window, self._docks = settings, window, docks
        self._numbers: dict[str, QDoubleSpinBox] = {}
        self._texts: dict[str, QLineEdit] = {}
        self._timer = QTimer(self, interval=SAVE_MS)
        self._timer.timeout.connect(self.save)

    def keep_number(self, key: str, box: QDoubleSpinBox) -> None:
        """Restore a number, and remember it from now on."""
        box.setValue(self._settings.value(key, box.value()))
        self._numbers[key] = box

    def keep_text(self, key: str, field: QLineEdit) -> None:
        """Restore a text such as a folder, and remember it from now on."""
        field.setText(self._settings.value(key, field.text()))
        self._texts[key] = field

    def restore_layout(self) -> None:
        """Restore size and docks, and begin to remember changes."""
        if geometry := self._bytes("geometry"):
            self._window.restoreGeometry(QByteArray(geometry))
        if layout := self._bytes("layout"):
            self._docks.restore(layout)
        self._timer.start()

    def close(self) -> None:
        """Remember everything for the last time."""
        self._timer.stop()
        self.save()

    def save(self) -> None:
        """Remember everything now."""
        settings = self._settings
        settings.set_value("geometry", _text(bytes(self._window.saveGeometry().data())))
        settings.set_value("layout", _text(self._docks.save()))
        for key, box in self._numbers.items():
            settings.set_value(key, box.value())
        for key, field in self._texts.items():
            settings.set_value(key, field.text())
        settings.write()

    def _bytes(self, key: str) -> bytes:
        try:
            return b64decode(self._settings.value(key, ""), validate=True)
        except (Base64Error, ValueError):
            return b""


def _text(data: bytes) -> str:
    return b64encode(data).decode()
