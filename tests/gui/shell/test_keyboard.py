"""The keyboard is enough: Tab and F6 reach everything on the screen, and no key slips."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QEvent, QPoint, QRect, Qt
from PySide6.QtGui import QImage, QKeyEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QPushButton,
    QTableView,
    QWidget,
)

from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from rigctl.boards.drum_states import State
from tests.gui.rig_window import SMALL
from tests.gui.steps import Harness, SharedWindow, wait_until
from tests.session.building import record_plan

Key, Modifier = Qt.Key, Qt.KeyboardModifier
PANELS = {"operate": Key.Key_1, "protocol": Key.Key_2, "analysis": Key.Key_3, "finger": Key.Key_4}
MOST_CONTROLS = 120
RUNNING = {"state": "running", "session": "/data/s", "prompt": None}
PROMPT = {"id": 4, "text": "mount plate B, then continue", "texture": "B"}


@pytest.fixture
def small(harness: Harness) -> Iterator[Harness]:
    """Yield a small window in front of all others, with an armed drum and samples."""
    window, before = harness.window, harness.window.size()
    window.resize(*SMALL)
    window.activateWindow()
    harness.engine.write_samples(3000)
    harness.update(state=int(State.ARMED), fault=0, fault_words="")
    wait_until(window.isActiveWindow)
    yield harness
    window.resize(before)


def _focus(window: MainWindow) -> QWidget:
    """Return what gets the next key."""
    return QApplication.focusWidget() or window


def _press(window: MainWindow, key: Key, modifier: Modifier = Modifier.NoModifier) -> None:
    QTest.keyClick(_focus(window), key, modifier)


def _tab_round(window: MainWindow) -> list[QWidget]:
    """Return what Tab reaches, from the present focus until it comes back."""
    found = [_focus(window)]
    for _ in range(MOST_CONTROLS):
        _press(window, Key.Key_Tab)
        if _focus(window) is found[0]:
            return found
        found.append(_focus(window))
    raise AssertionError(f"Tab never comes back from {found[-3:]}")


def _controls(region: QWidget) -> list[QWidget]:
    """Return the enabled controls that a user sees in a region."""
    kinds = (QPushButton, QComboBox, QLineEdit, QAbstractSpinBox, QTableView)
    inside = (QComboBox, QAbstractSpinBox)
    found: list[QWidget] = [widget for kind in kinds for widget in region.findChildren(kind)]
    return [
        w for w in found if w.isVisible() and w.isEnabled() and not isinstance(w.parent(), inside)
    ]


@pytest.mark.parametrize("name", PANELS)
def test_tab_reaches_each_control_on_the_screen_and_none_behind_it(
    small: Harness, name: str
) -> None:
    window = small.window
    _press(window, PANELS[name], Modifier.ControlModifier)
    reached = _tab_round(window)
    panel = window.docks.docks[name]
    visited = set(reached)
    assert [w for w in _controls(panel) if w not in visited and w.window() is window] == []
    others = [dock for other, dock in window.docks.docks.items() if other not in (name, "log")]
    assert [w for w in reached if any(dock.isAncestorOf(w) for dock in others)] == []
    assert window.docks.docks[name].isAncestorOf(reached[0])
    _press(window, Key.Key_Backtab, Modifier.ShiftModifier)
    assert _focus(window) is reached[-1]


def press_place(widget: QWidget, key: int, scan_code: int, text: str) -> None:
    """Press a key of another alphabet with Ctrl, as Qt tells it."""
    offset = 8 if sys.platform.startswith("linux") else 0
    control = Qt.KeyboardModifier.ControlModifier
    for kind in (QEvent.Type.KeyPress, QEvent.Type.KeyRelease):
        event = QKeyEvent(kind, key, control, scan_code + offset, 0, 0, text)
        QApplication.sendEvent(widget, event)


def test_shortcuts_are_where_their_keys_stand_on_a_cyrillic_or_greek_layout(
    disconnected: SharedWindow,
) -> None:
    window = disconnected.window
    window.show_panel("operate")
    press_place(window, ord("Д"), 38, "")  # where L is
    assert window.stack.currentWidget() is window.analysis_tab.sessions
    window.show_panel("operate")
    window.stack.show_page("live")
    press_place(window, ord("Ο"), 24, "")  # Greek omicron, where O is
    assert window.stack.currentWidget() is window.file_browser
    window.file_browser.dismiss()
    press_place(window, ord("é"), 3, "")  # where 2 is, on a French keyboard
    assert window.docks.docks["protocol"].isVisible()
    window.show_panel("operate")


def test_copied_rows_are_a_table_with_its_header(harness: Harness, tmp_path: Path) -> None:
    window, page = harness.window, harness.window.protocol_panel.page
    record_plan(tmp_path / "session")
    window.show_panel("protocol")
    window.protocol_panel.show_page(True)
    page.open_session(str(tmp_path / "session"))
    wait_until(lambda: page.attempt_view.model().rowCount() == 8)
    page.attempt_view.selectRow(2)
    QTest.keyClick(page.attempt_view, Qt.Key.Key_C, Qt.KeyboardModifier.ControlModifier)
    names, row = QApplication.clipboard().text().split("\n")
    assert names.split("\t")[:3] == ["Trial", "Plate", "Speed (mm/s)"]
    assert row.split("\t")[0] == "3" and len(row.split("\t")) == len(names.split("\t"))
    QApplication.clipboard().clear()
    page.attempt_view.setFocus()
    press_place(page.attempt_view, ord("С"), 46, "")  # Cyrillic, where C is
    assert QApplication.clipboard().text().startswith("Trial\tPlate")
    window.protocol_panel.show_page(False)


def test_tab_reaches_everything_on_the_start_page(small: Harness) -> None:
    window, page = small.window, small.window.start
    window.start.show_page()
    page.sample_box.show_progress("Making", "")
    window.setFocus()
    _press(window, Key.Key_Tab)
    reached = set(_tab_round(window))
    buttons = (page.virtual, page.sample, page.session, page.back, page.sample_box.cancel_button)
    assert reached.issuperset(buttons) and reached.issuperset(_controls(page))
    page.sample_box.clear()
    page.back.setFocus()
    _press(window, Key.Key_Return)
    assert not page.isVisible()


def _looks(window: MainWindow, place: QRect) -> QImage:
    return window.grab(place).toImage()


def _is_seen(window: MainWindow, widget: QWidget) -> bool:
    """Return whether a widget is in view and looks otherwise with the focus than without it."""
    place = QRect(widget.mapTo(window, QPoint()), widget.size()).adjusted(-2, -2, 2, 2)
    with_focus = _looks(window, place)
    window.setFocus()
    without = _looks(window, place)
    widget.setFocus()
    return window.rect().intersects(place) and with_focus != without


@pytest.mark.parametrize("choice", [ThemeChoice.LIGHT, ThemeChoice.DARK])
def test_the_focus_is_in_view_and_can_be_seen(small: Harness, choice: ThemeChoice) -> None:
    window, unseen = small.window, []
    window.appearance.set_theme(choice)
    try:
        for name, key in PANELS.items():
            _press(window, key, Modifier.ControlModifier)
            first = _focus(window)
            for _ in range(MOST_CONTROLS):
                widget = _focus(window)
                if not _is_seen(window, widget):
                    unseen.append(f"{name}: {type(widget).__name__} {widget.geometry()}")
                _press(window, Key.Key_Tab)
                if _focus(window) is first:
                    break
    finally:
        window.appearance.set_theme(ThemeChoice.LIGHT)
    assert unseen == []


@pytest.mark.parametrize("key", [Key.Key_Return, Key.Key_Space])
def test_a_second_press_never_reaches_the_next_button(small: Harness, key: Key) -> None:
    """Qt gives the focus of a button that goes off to its neighbour: Approach, then Run."""
    window, buttons = small.window, small.window.operate_panel.buttons
    buttons["approach"].setFocus()
    _press(window, key)
    small.update(state=int(State.APPROACH))
    _press(window, key)
    small.update(state=int(State.HOLD))
    _press(window, key)
    assert small.engine.commands == ["approach"]
    _press(window, Key.Key_Tab)
    assert buttons["run"].hasFocus()


def test_the_focus_returns_to_a_button_that_is_on_again(small: Harness) -> None:
    window, buttons = small.window, small.window.operate_panel.buttons
    buttons["home"].setFocus()
    _press(window, Key.Key_Return)
    small.update(state=int(State.POSITION))
    assert not buttons["home"].isEnabled()
    small.update(state=int(State.ARMED))
    assert buttons["home"].hasFocus()
    assert small.engine.commands == ["home"]


def test_a_second_press_on_pause_does_not_abort_the_run(small: Harness) -> None:
    window, buttons = small.window, small.window.protocol_panel.buttons
    window.show_panel("protocol")
    small.update(run=RUNNING)
    buttons["Pause"].setFocus()
    _press(window, Key.Key_Space)
    small.update(run={"state": "paused", "reasons": ["operator"]})
    _press(window, Key.Key_Space)
    assert small.engine.commands == ["pause"]
    _press(window, Key.Key_Tab)
    assert buttons["Resume"].hasFocus()


def test_the_answer_to_a_question_presses_nothing_else(small: Harness) -> None:
    window = small.window
    small.update(run={"state": "prompt", "reasons": ["prompt"], "prompt": PROMPT})
    window.prompt_panel.confirm.setFocus()
    _press(window, Key.Key_Return)
    small.update(run=RUNNING)
    assert not window.prompt_panel.isVisible()
    _press(window, Key.Key_Return)
    assert small.engine.commands == ["answer"]


def test_f6_visits_heading_question_panel_middle_and_log(small: Harness) -> None:
    window = small.window
    small.update(run={"state": "prompt", "reasons": ["prompt"], "prompt": PROMPT})
    _press(window, Key.Key_1, Modifier.ControlModifier)
    panel = window.docks.docks["operate"]
    regions = [panel, window.stack, window.docks.docks["log"], window.toolbar, window.prompt_panel]
    for region in (*regions, panel):
        assert region.isAncestorOf(_focus(window))
        _press(window, Key.Key_F6)
    _press(window, Key.Key_F6, Modifier.ShiftModifier)
    assert panel.isAncestorOf(_focus(window))


def test_tab_leaves_a_table_of_trials(small: Harness) -> None:
    window = small.window
    window.show_panel("analysis")
    table = window.analysis_tab.panel.table
    table.setFocus()
    _press(window, Key.Key_Tab)
    assert not table.hasFocus()
