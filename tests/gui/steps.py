"""The user's actions as functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from PySide6.QtCore import QCoreApplication, QEvent, QEventLoop, QPoint, QPointF, Qt, QTimer
from PySide6.QtGui import QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QPushButton, QWidget
from shiboken6 import delete, isValid

from gui.analysis.export import ExportButton
from gui.finger.finger_tab import FingerTab
from gui.link.engine_link import FingerEngineSpec, open_client
from gui.shell.main_window import MainWindow
from gui.shell.user_settings import UserSettings
from gui.widgets.theme import ThemeChoice
from rigctl.errors import RigctlError
from tests.gui.fake_engine import FakeEngine
from tests.gui.fake_finger import FakeFinger

TIMEOUT_MS = 20_000
_FIRST_LOOK_MS, _LOOK_MS = 5, 40
"""A window that is looked at all the time takes the processor from what the test waits for."""


@contextmanager
def own_window(
    engine: FakeEngine | None = None, settings: UserSettings | None = None
) -> Iterator[MainWindow]:
    """Yield a window on that engine, else on real ones; delete it with the menus of its plots.

    Each widget that is left is drawn anew with every theme and text size of later tests.
    """
    before = set(QApplication.topLevelWidgets())
    factory = open_client if engine is None else lambda *_: engine
    window = MainWindow(factory, ThemeChoice.LIGHT, settings=settings)
    made = set(QApplication.topLevelWidgets()) - before
    try:
        yield window
    finally:
        whole = window.window()  # which has the pages of further rigs, too
        whole.close()
        delete(whole)
        for menu in filter(isValid, made):
            menu.deleteLater()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)


class SharedWindow:
    """A window that connects to ``engine`` or fails with ``error``, which each test sets.

    ``finger`` and ``finger_specs`` are those of the moving finger.
    """

    def __init__(self) -> None:
        self.engine: FakeEngine | None = None
        self.error: RigctlError | None = None
        self.opened: list[tuple[str, str]] = []
        self.finger: FakeFinger | None = None
        self.finger_specs: list[FingerEngineSpec] = []
        self.window = MainWindow(self._open, ThemeChoice.LIGHT, self._open_finger)
        self.window.resize(1280, 800)

    def _open(self, rig: str, world: str) -> FakeEngine:
        self.opened.append((rig, world))
        if self.error is not None:
            raise self.error
        assert self.engine is not None
        return self.engine

    def _open_finger(self, spec: FingerEngineSpec) -> FakeFinger:
        self.finger_specs.append(spec)
        if self.error is not None:
            raise self.error
        assert self.finger is not None
        return self.finger


class Harness(NamedTuple):
    """A window and its engine."""

    window: MainWindow
    engine: FakeEngine

    def update(self, **changes: Any) -> None:
        """Send a status with some changes to the window."""
        self.engine.send_status(**changes)
        self.window.poll()


class FingerWindow(NamedTuple):
    """A window and its engine of the moving finger."""

    window: MainWindow
    engine: FakeFinger

    @property
    def tab(self) -> FingerTab:
        """The tab."""
        return self.window.finger_tab

    def update(self, **changes: Any) -> None:
        """Send a status with some changes to the window, and whatever was sent before."""
        self.engine.send_status(**changes)
        self.window.poll()


def process_events(duration_ms: int) -> None:
    """Process Qt events for a while; other threads run meanwhile, which ``QTest.qWait`` stops."""
    loop = QEventLoop()
    QTimer.singleShot(duration_ms, loop.quit)
    loop.exec()


def wait_until(done: Callable[[], bool], timeout_ms: int = TIMEOUT_MS) -> None:
    """Process Qt events until a condition is true."""
    waited_ms, look_ms = 0, _FIRST_LOOK_MS
    while waited_ms < timeout_ms:
        if done():
            return
        process_events(look_ms)
        waited_ms += look_ms
        look_ms = min(2 * look_ms, _LOOK_MS)
    raise AssertionError(f"the condition is not true after {timeout_ms} ms")


def save_page(harness: Harness, button: ExportButton, suffix: str) -> Path:
    """Save the page that a button is on; return the file that the log names."""
    log = harness.window.event_log
    n_before = len(log.toPlainText())
    actions = {action.text(): action for action in button.formats.actions()}
    actions[suffix.upper()].trigger()
    wait_until(lambda: f".{suffix}" in log.toPlainText()[n_before:])
    return Path(log.toPlainText()[n_before:].partition("saved ")[2].partition("\n")[0])


def click(button: QPushButton) -> None:
    """Click a button with the left mouse button."""
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)


def press_escape(widget: QWidget) -> None:
    """Press Esc while that widget has the focus."""
    QTest.keyClick(widget, Qt.Key.Key_Escape)


def turn_wheel(box: QWidget) -> None:
    """Turn the wheel down by a notch over a box, which may be out of sight."""
    at, turn = QPointF(box.rect().center()), QPoint(0, -120)
    keys, phase = Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase
    on_screen = QPointF(box.mapToGlobal(box.rect().center()))
    none = Qt.MouseButton.NoButton
    event = QWheelEvent(at, on_screen, QPoint(), turn, none, keys, phase, False)
    QApplication.sendEvent(box, event)
