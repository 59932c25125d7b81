"""STOP works always: by mouse, by Esc, whatever has the focus, whatever is shown."""

from __future__ import annotations

from PySide6.QtCore import QPoint
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu

from rigctl.wire.drum_states import State
from tests.gui.steps import Bench, click, press_escape, wait_until


def test_the_button_stops(bench: Bench) -> None:
    click(bench.window.toolbar.stop)
    assert bench.engine.commands == ["stop"]


def test_it_can_be_pressed_in_every_state(bench: Bench) -> None:
    for state in State:
        bench.see(state=int(state))
        click(bench.window.toolbar.stop)
    assert bench.engine.commands == ["stop"] * len(State)


def test_escape_stops_from_a_spin_box(bench: Bench) -> None:
    box = bench.window.operate.speed
    box.setFocus()
    press_escape(box)
    assert bench.engine.commands == ["stop"]


def test_escape_stops_from_a_text_field_and_a_list(bench: Bench) -> None:
    bench.window.tabs.setCurrentIndex(1)
    press_escape(bench.window.protocol.out)
    press_escape(bench.window.protocol.choice)
    assert bench.engine.commands == ["stop", "stop"]


def test_escape_stops_and_closes_an_open_menu(bench: Bench) -> None:
    menu = bench.window.menuBar().findChild(QMenu)
    assert menu is not None
    menu.popup(bench.window.mapToGlobal(QPoint(5, 30)))
    wait_until(menu.isVisible)
    press_escape(menu)
    assert bench.engine.commands == ["stop"]
    assert not menu.isVisible()


def test_escape_stops_from_an_open_list(bench: Bench) -> None:
    bench.see()
    plate = bench.window.operate.bench.plate
    plate.showPopup()
    press_escape(plate.view())
    plate.hidePopup()
    assert set(bench.engine.commands) == {"stop"}


def test_escape_stops_from_the_file_chooser_which_covers_nothing(bench: Bench) -> None:
    window = bench.window
    window.tabs.setCurrentIndex(1)
    window.protocol.folder_asked.emit()
    dialog = window.browser.dialog
    assert dialog is not None and not dialog.isModal() and not dialog.isWindow()
    press_escape(dialog)
    assert bench.engine.commands == ["stop"]
    assert QApplication.activeModalWidget() is None
    place = window.toolbar.stop.mapTo(window, window.toolbar.stop.rect().center())
    assert window.childAt(place) is window.toolbar.stop
    window.browser.dismiss()


def test_a_prompt_leaves_stop_uncovered(bench: Bench) -> None:
    prompt = {"id": 3, "text": "Mount plate B, then confirm.", "texture": "B"}
    bench.see(run={"state": "prompt", "prompt": prompt})
    window = bench.window
    assert window.prompt.isVisibleTo(window)
    place = window.toolbar.stop.mapTo(window, window.toolbar.stop.rect().center())
    assert window.childAt(place) is window.toolbar.stop


def test_an_engine_that_does_not_answer_stop_is_reported(bench: Bench) -> None:
    bench.engine.answers = False
    click(bench.window.toolbar.stop)
    wait_until(lambda: "press the emergency stop" in bench.window.sentence.text())


def test_stop_without_a_rig_says_so(bench: Bench) -> None:
    click(bench.window.toolbar.connect_button)
    click(bench.window.toolbar.stop)
    assert "no rig is connected" in bench.window.sentence.text()
    QTest.qWait(1)
    assert bench.engine.commands == []
