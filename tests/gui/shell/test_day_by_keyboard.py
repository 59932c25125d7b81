"""A day at the window by keys alone: from Connect to a saved figure, on the virtual rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget

from gui.live.live_page import SAVE
from gui.operate.operate_panel import READY
from rigctl.boards.drum_states import State
from rigctl.session.verify import verify
from tests.gui.rig_window import RigWindow, opened_window
from tests.gui.running_engine import ridges
from tests.gui.steps import wait_until

Key, Modifier = Qt.Key, Qt.KeyboardModifier
CONTROL, SHIFT = Modifier.ControlModifier, Modifier.ShiftModifier
OPERATE, PROTOCOL, ANALYSIS = Key.Key_1, Key.Key_2, Key.Key_3
MOST_TABS = 60
NOTE = "the plate is dusty"
TRIALS = ridges("day", 3) + "[trial]\ntravel_mm = 60\n"


class MouseWatch(QObject):
    """Counts the mouse events of the program."""

    seen = 0

    def eventFilter(self, _: QObject, event: QEvent) -> bool:
        """Count an event, and let it pass."""
        self.seen += event.type() in (QEvent.Type.MouseButtonPress, QEvent.Type.MouseButtonDblClick)
        return False


class Typist:
    """A person with a keyboard and no mouse."""

    def __init__(self, rig: RigWindow) -> None:
        self.rig, self.window = rig, rig.window

    def press(self, key: Key, modifier: Modifier = Modifier.NoModifier) -> None:
        """Press a key where the focus is."""
        if QApplication.activeWindow() is None:  # offscreen, a completer's list takes it along
            self.window.activateWindow()
            self.rig.until(self.window.isActiveWindow)
        QTest.keyClick(QApplication.focusWidget() or self.window, key, modifier)

    def write(self, text: str) -> None:
        """Replace what is in the field with the focus."""
        self.press(Key.Key_A, CONTROL)
        QTest.keyClicks(QApplication.focusWidget(), text)

    def go_to(self, widget: QWidget) -> None:
        """Press Tab until a control has the focus, as soon as it can have it."""
        self.rig.until(lambda: widget.isEnabled() and widget.isVisible())
        way = []
        for _ in range(MOST_TABS):
            if widget.hasFocus():
                return
            way.append(QApplication.focusWidget())
            self.press(Key.Key_Tab)
        raise AssertionError(f"Tab does not reach {widget}, but {way}\n{self.rig.log}")

    def act(self, button: QWidget) -> None:
        """Go to a button and press Return."""
        self.go_to(button)
        self.press(Key.Key_Return)

    def choose(self, region: Callable[[QWidget], bool]) -> None:
        """Press F6 until a region of the window has the focus."""
        for _ in range(8):
            focus = QApplication.focusWidget()
            if focus is not None and region(focus):
                return
            self.press(Key.Key_F6)
        raise AssertionError("F6 does not reach the region")


@pytest.fixture
def typist(qapp: QApplication, tmp_path: Path) -> Iterator[Typist]:
    """Yield a person at a small window that is not connected; a mouse event fails the test."""
    watch = MouseWatch()
    with opened_window() as rig:
        rig.window.activateWindow()
        wait_until(rig.window.isActiveWindow)
        qapp.installEventFilter(watch)
        yield Typist(rig)
        qapp.removeEventFilter(watch)
    assert watch.seen == 0


def _bring_up(day: Typist) -> None:
    box, rig = day.window.operate_panel.bring_up, day.rig
    day.press(OPERATE, CONTROL)
    while box.missing.text() != READY:
        before = box.next.text()
        day.act(box.next)
        rig.until(lambda before=before: box.next.text() != before)
    assert rig.status.tared and rig.status.state is not State.IDLE


def _touch(day: Typist) -> None:
    buttons = day.window.operate_panel.buttons
    day.act(buttons["approach"])
    day.rig.until_state(State.HOLD)
    day.act(buttons["retract"])
    day.rig.until_state(State.ARMED)


def _start_run(day: Typist, protocol: Path, out: Path) -> None:
    panel, rig = day.window.protocol_panel, day.rig
    day.press(PROTOCOL, CONTROL)
    _open_file(day, panel.open_button, protocol)
    rig.until(lambda: panel.protocol.currentData() == str(protocol))
    day.go_to(panel.out)
    day.write(str(out))
    day.act(panel.buttons["Start"])
    rig.until(day.window.prompt_panel.isVisible)
    day.choose(day.window.prompt_panel.isAncestorOf)
    day.act(day.window.prompt_panel.confirm)
    rig.until(lambda: rig.status.run.trials_committed >= 1)


def _open_file(day: Typist, button: QWidget, path: Path) -> None:
    """Press a button that opens the file browser, and type a path."""
    day.act(button)
    browser = day.window.file_browser
    day.rig.until(browser.isVisible)
    day.write(str(path))
    day.press(Key.Key_Return)
    day.rig.until(lambda: browser.dialog is None)
    assert button.hasFocus()


def _pause_and_note(day: Typist) -> None:
    panel, rig = day.window.protocol_panel, day.rig
    day.press(PROTOCOL, CONTROL)
    day.act(panel.buttons["Pause"])
    rig.until(lambda: rig.status.run.state == "paused")
    day.act(panel.page_button)
    day.choose(panel.page.isAncestorOf)
    day.go_to(panel.page.text)
    day.write(NOTE)
    day.press(Key.Key_Return)
    rig.until(lambda: panel.page.text.text() == "")


def _analyse(day: Typist) -> None:
    tab, rig = day.window.analysis_tab, day.rig
    strip = day.window.run_end_strip
    rig.until(strip.isVisible)
    day.choose(strip.isAncestorOf)
    day.act(strip.analyse_button)
    rig.until(lambda: tab.trial_view.data is not None and not tab.reader.is_busy)
    day.press(ANALYSIS, CONTROL)
    day.go_to(tab.panel.table)
    day.press(Key.Key_Down)
    rig.until(lambda: not tab.reader.is_busy)


def _export(day: Typist, folder: Path) -> None:
    """Save the live plots as a picture."""
    page = day.window.live_page
    day.press(OPERATE, CONTROL)
    day.choose(day.window.stack.isAncestorOf)
    day.act(page.bar.buttons[SAVE])
    day.go_to(page.save_strip.folder)
    day.write(str(folder))
    day.act(page.save_strip.picture)
    day.rig.until(lambda: "saved " in day.rig.log)


def test_a_day_needs_no_mouse(typist: Typist, tmp_path: Path) -> None:
    day, rig, window = typist, typist.rig, typist.window
    protocol, out = tmp_path / "day.toml", tmp_path / "sessions"
    protocol.write_text(TRIALS)
    out.mkdir()
    day.press(Key.Key_R, CONTROL)
    rig.until(lambda: rig.status.drum_connected and rig.status.taxels_connected)
    _bring_up(day)
    _touch(day)
    _start_run(day, protocol, out)
    _pause_and_note(day)
    day.press(Key.Key_Escape)
    rig.until(lambda: rig.status.run.state == "aborted")
    _analyse(day)
    _export(day, tmp_path / "pictures")
    day.press(Key.Key_Q, CONTROL)
    rig.until(lambda: not window.isVisible())
    (session,) = out.iterdir()
    assert verify(session).problems == []
    assert any(NOTE in path.read_text() for path in session.glob("*.json"))
    assert list((tmp_path / "pictures").iterdir())
