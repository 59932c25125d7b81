"""What a person at the window does, in a line each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton, QWidget

from gui.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from tests.gui.fake_engine import FakeEngine

LIMIT_MS = 20_000
_LOOK_MS = 5


class Shown:
    """A window whose rig is whatever engine is put here before it connects."""

    def __init__(self) -> None:
        self.engine: FakeEngine | None = None
        self.window = MainWindow(self._open, ThemeChoice.LIGHT)

    def _open(self, rig: str, world: str) -> FakeEngine:
        assert self.engine is not None
        return self.engine


class Bench(NamedTuple):
    """A window and the engine behind it."""

    window: MainWindow
    engine: FakeEngine

    def see(self, **changes: Any) -> None:
        """Have the engine say a status and the window take it."""
        self.engine.say_status(**changes)
        self.window.poll()


def wait_until(done: Callable[[], bool], limit_ms: int = LIMIT_MS) -> None:
    """Let Qt work until something is so."""
    for _ in range(limit_ms // _LOOK_MS):
        if done():
            return
        QTest.qWait(_LOOK_MS)
    raise AssertionError(f"did not come about within {limit_ms} ms")


def click(button: QPushButton) -> None:
    """Press a button with the left mouse button."""
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def press_escape(widget: QWidget) -> None:
    """Press Esc while that widget has the focus."""
    QTest.keyClick(widget, Qt.Key.Key_Escape)
