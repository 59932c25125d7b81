"""Layout, set-points, folders and views that return when the window opens again."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Callable
from typing import TypeVar

from PySide6.QtCore import QByteArray, QObject, QTimer
from PySide6.QtWidgets import QLineEdit, QWidget

from gui.live.live_page import LivePage
from gui.live.navigation import SPANS_S
from gui.shell.docks import DockArea
from gui.shell.user_settings import MAX_LETTERS, UserSettings
from gui.widgets.number_box import NumberBox

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
