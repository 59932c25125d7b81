"""The window's frame: what is always on the screen, docks, and the colours of the log."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtCore import QPoint, QRect, QSize, Qt
from PySide6.QtGui import QAccessible, QGuiApplication
from PySide6.QtWidgets import QApplication, QScrollArea, QWidget

from gui.shell.main_window import NOT_AT_REST
from gui.widgets.layouts import PanelArea
from gui.widgets.theme import DARK, LIGHT, ThemeChoice, applied_theme, text_scale
from rigctl.boards.drum_states import State
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import Harness, own_window, wait_until

SMALL = QSize(1024, 700)
AT_REST: dict[str, Any] = {"state": int(State.ARMED), "run": {"state": "idle"}}
BUSY: tuple[dict[str, Any], ...] = (
    {"state": int(State.HOLD)},
    {"run": {"state": "paused"}},
    {"state": int(State.POSITION)},
)
PROMPT = {"id": 1, "text": "mount plate L, then continue", "texture": "L"}


def _is_whole(window: QWidget, widget: QWidget) -> bool:
    """Return whether every pixel of a widget is inside the window."""
    place = QRect(widget.mapTo(window, QPoint()), widget.size())
    return widget.isVisibleTo(window) and window.rect().contains(place)


def _fits(window: QWidget, size: QSize) -> bool:
    """Resize a window; return whether it took the size. Its layout follows a little later."""
    window.resize(size)
    return window.size() == size


def test_theme_and_text_size_wait_until_the_rig_is_at_rest(harness: Harness) -> None:
    """All widgets are styled anew in one piece, for which STOP would wait."""
    window = harness.window
    choices = {
        (menu.rpartition(" ")[2], action.text()): action
        for menu, action in window.menus.actions()
        if menu.endswith(("Theme", "Text size"))
    }
    dark, large = choices["Theme", "Dark"], choices["size", "115 %"]
    for busy in BUSY:
        harness.update(**AT_REST)
        harness.update(**busy)
        for action in (dark, large):
            action.trigger()
            assert NOT_AT_REST in window.status_line.text(), busy
            window.status_line.clear()
        assert applied_theme() is LIGHT and text_scale() == 1
        assert choices["Theme", "Light"].isChecked() and choices["size", "100 %"].isChecked()
    harness.update(**AT_REST)
    try:
        dark.trigger()
        large.trigger()
        assert applied_theme() is DARK and text_scale() == 1.15
    finally:
        choices["Theme", "Light"].trigger()
        choices["size", "100 %"].trigger()
    assert NOT_AT_REST not in window.status_line.text()


def test_a_command_without_an_answer_keeps_the_theme(harness: Harness) -> None:
    harness.update(state=int(State.ARMED))
    harness.engine.replies = False
    harness.window.engine_link.request("approach")
    dark = next(action for _, action in harness.window.menus.actions() if action.text() == "Dark")
    dark.trigger()
    assert applied_theme() is LIGHT
    harness.engine.answer_all()
    harness.window.poll()


@pytest.mark.parametrize("panel", ["operate", "protocol", "analysis", "finger"])
def test_small_screen_shows_heading_stop_and_log_beside_a_question(
    harness: Harness, panel: str
) -> None:
    window, before = harness.window, harness.window.size()
    window.show_panel(panel)
    waiting = {"state": "prompt", "reasons": ["prompt"], "prompt": PROMPT}
    harness.update(state=int(State.FAULT_OFF), fault=2, fault_words="too much force", run=waiting)
    try:
        wait_until(lambda: _fits(window, SMALL))
        for widget in (window.toolbar, window.toolbar.stop_button, window.event_log):
            assert _is_whole(window, widget)
    finally:
        window.resize(before)


def test_window_opens_no_larger_than_the_screen(qapp: QApplication, engine: FakeEngine) -> None:
    with own_window(engine) as window:
        screen = QGuiApplication.primaryScreen().availableSize()
        assert window.width() <= max(screen.width(), window.minimumSizeHint().width())
        assert window.height() <= screen.height()
        assert window.minimumSizeHint().expandedTo(SMALL) == SMALL


def test_panels_are_never_narrower_than_their_contents(harness: Harness) -> None:
    window = harness.window
    for name in ("operate", "protocol", "analysis", "finger"):
        window.show_panel(name)
        area = window.docks.docks[name].findChild(PanelArea)
        assert isinstance(area, QScrollArea)
        window.docks.resizeDocks([window.docks.docks[name]], [50], Qt.Orientation.Horizontal)
        QApplication.processEvents()
        assert area.viewport().width() >= area.widget().minimumSizeHint().width()


def test_errors_of_the_log_stay_red_in_another_theme(harness: Harness) -> None:
    window = harness.window
    window.report("fault", "the emergency stop is pressed")
    window.set_theme(ThemeChoice.DARK)
    try:
        assert applied_theme().bad in window.event_log.document().toHtml()
        assert "the emergency stop is pressed" in window.event_log.toPlainText()
    finally:
        window.set_theme(ThemeChoice.LIGHT)


def test_red_line_fades_when_nothing_follows(harness: Harness) -> None:
    line = harness.window.status_line
    harness.window.report("refused", "approach: tare first")
    assert line.property("role") == "bad"
    line.red_timer.start(0)
    wait_until(lambda: line.property("role") == "muted")
    assert line.text() == "approach: tare first"


def test_a_long_event_is_shortened_in_the_line_and_whole_beside_it(harness: Harness) -> None:
    """The end of a long refusal, which is its cure, was cut off without a sign."""
    window, line = harness.window, harness.window.status_line
    before = window.size()
    sentence = f"approach: {'the load cell reads 12 g without contact, ' * 8}tare it first"
    try:
        window.resize(1024, 700)
        window.report("refused", sentence)
        wait_until(lambda: line.width() < 1024)
        assert line.shown_text.endswith("…") and sentence.startswith(line.shown_text[:-1])
        assert line.fontMetrics().horizontalAdvance(line.shown_text) <= line.width()
        assert line.toolTip() == sentence
        interface = QAccessible.queryAccessibleInterface(line)
        assert interface.text(QAccessible.Text.Name) == sentence
        assert sentence in window.event_log.toPlainText()
        window.status_line.show_event("refused", "tare first")
        assert line.shown_text == "tare first"
    finally:
        window.resize(before)


def test_middle_follows_the_panel_that_is_used(harness: Harness) -> None:
    window = harness.window
    window.show_panel("analysis")
    assert window.stack.currentWidget() is window.analysis_tab.view
    window.docks.docks["analysis"].close()
    window.show_panel("operate")
    assert window.stack.currentWidget() is window.live_page
    window.show_panel("analysis")
    assert window.docks.docks["analysis"].isVisibleTo(window)


def test_one_page_is_left_on_the_screen_wherever_the_focus_was(harness: Harness) -> None:
    window, pages = harness.window, harness.window.analysis_tab.trial_view
    window.activateWindow()
    window.show_panel("analysis")
    pages.setCurrentWidget(pages.features)
    pages.features.graphics.setFocus()
    wait_until(pages.features.graphics.hasFocus)
    window.show_panel("finger")
    every = [window.stack.widget(i) for i in range(window.stack.count())]
    shown = [area.page for area in every if area.isVisible()]
    assert shown == [window.finger_tab.view] and shown[0].isVisible()
    assert window.toolbar.pages.currentIndex() == 1
    pages.setCurrentIndex(0)


def test_log_can_neither_be_closed_nor_float(harness: Harness) -> None:
    dock = harness.window.docks.docks["log"]
    features = dock.features()
    assert not features & dock.DockWidgetFeature.DockWidgetClosable
    assert not features & dock.DockWidgetFeature.DockWidgetFloatable
