"""A panel that floats is a window of its own, and has the keys of the window."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QDockWidget, QWidget

from gui.widgets.labels import StopButton
from rigctl.boards.drum_states import State
from tests.gui.steps import Harness, click, press_escape, wait_until

Key, Modifier = Qt.Key, Qt.KeyboardModifier
FLOAT_BUTTON = "qt_dockwidget_floatbutton"


@pytest.fixture
def floating(harness: Harness) -> Iterator[tuple[Harness, QDockWidget]]:
    """Yield the window with the panel Operate as a window of its own, in front."""
    window = harness.window
    dock = window.docks.docks["operate"]
    window.show_panel("operate")
    harness.update(state=int(State.ARMED), fault=0, fault_words="")
    window.activateWindow()
    wait_until(window.isActiveWindow)
    window.setFocus()
    button = dock.findChild(QAbstractButton, FLOAT_BUTTON)
    QTest.mouseClick(button, Qt.MouseButton.LeftButton)
    dock.activateWindow()
    wait_until(dock.isActiveWindow)
    yield harness, dock
    window.docks.reset()
    window.activateWindow()
    wait_until(window.isActiveWindow)


def focus() -> QWidget:
    """Return what gets the next key."""
    widget = QApplication.focusWidget()
    assert widget is not None
    return widget


def test_a_floating_panel_stops_by_escape_from_anywhere(
    floating: tuple[Harness, QDockWidget],
) -> None:
    harness, dock = floating
    assert dock.isWindow() and dock.isFloating()
    speed = harness.window.operate_panel.speed
    for widget in (dock, speed, harness.window.operate_panel.buttons["home"]):
        widget.setFocus()
        before = harness.engine.commands.count("stop")
        press_escape(focus())
        wait_until(lambda n=before: harness.engine.commands.count("stop") == n + 1)


def test_a_floating_panel_that_covers_stop_has_its_own(
    floating: tuple[Harness, QDockWidget],
) -> None:
    harness, dock = floating
    window, stop = harness.window, dock.findChild(StopButton)
    assert stop is not None and stop.isVisible() and stop.focusPolicy() is Qt.FocusPolicy.NoFocus
    dock.move(window.toolbar.stop_button.mapToGlobal(QPoint(-200, -10)))
    assert dock.geometry().contains(window.toolbar.stop_button.mapToGlobal(QPoint(10, 10)))
    dock.resize(1, 1)
    wait_until(lambda: dock.childAt(stop.mapTo(dock, stop.rect().center())) is stop)
    assert stop.width() >= stop.fontMetrics().horizontalAdvance(stop.text())
    click(stop)
    assert harness.engine.commands == ["stop"]
    docked = window.docks.docks["protocol"].findChild(StopButton)
    assert docked is not None and not docked.isVisible()
    layout = window.docks.save()
    window.docks.reset()
    assert not stop.isVisible()
    assert window.docks.restore(layout) and stop.isVisible()


def test_keys_in_a_floating_panel_are_those_of_a_docked_one(
    floating: tuple[Harness, QDockWidget],
) -> None:
    harness, dock = floating
    buttons = harness.window.operate_panel.buttons
    assert focus() is dock, "a new window presses nothing by itself"
    QTest.keyClick(dock, Key.Key_Return)
    assert harness.engine.commands == []
    buttons["approach"].setFocus()
    QTest.keyClick(focus(), Key.Key_Return)
    harness.update(state=int(State.APPROACH))
    assert not buttons["approach"].isEnabled() and focus() is dock
    QTest.keyClick(focus(), Key.Key_Return)
    harness.update(state=int(State.HOLD))
    QTest.keyClick(focus(), Key.Key_Space)
    assert harness.engine.commands == ["approach"]
    QTest.keyClick(focus(), Key.Key_Tab)
    assert buttons["run"].hasFocus()
    buttons["retract"].setFocus()
    QTest.keyClick(focus(), Key.Key_Space)
    harness.update(state=int(State.RETRACT))
    harness.update(state=int(State.HOLD))
    assert buttons["retract"].hasFocus(), "a button that is on again has the focus again"


def test_tab_and_regions_tell_a_floating_panel_from_the_window(
    floating: tuple[Harness, QDockWidget],
) -> None:
    harness, dock = floating
    window = harness.window
    first = None
    for _ in range(120):
        QTest.keyClick(focus(), Key.Key_Tab)
        assert focus().window() is dock
        if focus() is first:
            break
        first = first or focus()
    else:
        raise AssertionError("Tab never comes back")
    window.activateWindow()
    wait_until(window.isActiveWindow)
    window.toolbar.connect_button.setFocus()
    for _ in range(40):
        QTest.keyClick(focus(), Key.Key_Tab)
        assert focus().window() is window
    QTest.keyClick(focus(), Key.Key_1, Modifier.ControlModifier)
    wait_until(lambda: dock.isActiveWindow() and dock.isAncestorOf(focus()))
    QTest.keyClick(focus(), Key.Key_F6)
    wait_until(lambda: window.isActiveWindow() and not dock.isAncestorOf(focus()))


def test_a_floating_panel_floats_again_after_a_restart(
    floating: tuple[Harness, QDockWidget],
) -> None:
    harness, dock = floating
    docks = harness.window.docks
    layout, place = docks.save(), dock.geometry()
    docks.reset()
    assert not dock.isFloating() and not dock.isWindow()
    assert docks.restore(layout)
    assert dock.isFloating() and dock.isVisible() and dock.geometry().size() == place.size()
    press_escape(dock)
    wait_until(lambda: "stop" in harness.engine.commands)
