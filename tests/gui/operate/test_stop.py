"""STOP works by mouse and by Esc with every focus and in every view."""

from __future__ import annotations

import os
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QApplication, QMenu

from gui.shell.main_window import MainWindow
from rigctl.boards.drum_states import State
from rigctl.engine.rpc import client
from rigctl.engine.rpc.client import WINDOW, client_name
from rigctl.engine.rpc.engine_files import (
    FOLDER_VARIABLE,
    EngineFile,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.messages import RunStatus
from rigctl.engine.rpc.server import open_listener
from rigctl.errors import LinkLost
from rigctl.finger.status import FingerRunStatus
from tests.gui.fake_finger import RUNNING
from tests.gui.running_engine import start_protocol, wait_ended
from tests.gui.steps import FingerWindow, Harness, click, press_escape, wait_until


def test_button_stops(harness: Harness) -> None:
    click(harness.window.toolbar.stop_button)
    assert harness.engine.commands == ["stop"]


def test_button_stops_in_every_state(harness: Harness) -> None:
    for state in State:
        harness.update(state=int(state))
        click(harness.window.toolbar.stop_button)
    assert harness.engine.commands == ["stop"] * len(State)


def test_escape_stops_from_a_spin_box(harness: Harness) -> None:
    box = harness.window.operate_panel.speed
    box.setFocus()
    press_escape(box)
    assert harness.engine.commands == ["stop"]


def test_escape_stops_from_a_text_field_and_a_list(harness: Harness) -> None:
    harness.window.show_panel("protocol")
    press_escape(harness.window.protocol_panel.out)
    press_escape(harness.window.protocol_panel.protocol)
    assert harness.engine.commands == ["stop", "stop"]


MOVING: list[dict[str, Any]] = [
    {"state": int(State.RUN)},
    {"state": int(State.HOLD)},
    {"state": int(State.IDLE), "contact_may_stand": True},
    {"run": {"state": "paused"}},
    {"calibration": {"measuring": "range"}},
]
"""Statuses of a drum that moves, presses, is left in contact, has a run or is calibrated."""


def _open_menu(window: MainWindow) -> QMenu:
    menu = window.menuBar().findChild(QMenu)
    assert menu is not None
    menu.popup(window.mapToGlobal(QPoint(5, 30)))
    wait_until(menu.isVisible)
    return menu


@pytest.mark.parametrize("moving", MOVING)
def test_escape_stops_and_closes_an_open_menu(harness: Harness, moving: dict[str, Any]) -> None:
    harness.update(**moving)
    menu = _open_menu(harness.window)
    press_escape(menu)
    assert harness.engine.commands == ["stop"]
    assert not menu.isVisible()
    harness.update(run=asdict(RunStatus()))


@pytest.mark.parametrize("state", [State.IDLE, State.ARMED, State.FAULT_OFF])
def test_at_rest_escape_closes_an_open_menu_and_the_next_one_stops(
    harness: Harness, state: State
) -> None:
    harness.update(state=int(state))
    menu = _open_menu(harness.window)
    press_escape(menu)
    assert not menu.isVisible() and harness.engine.commands == []
    press_escape(harness.window)
    assert harness.engine.commands == ["stop"]


def test_escape_from_an_open_list_stops_a_drum_that_moves_only(harness: Harness) -> None:
    harness.window.show_panel("protocol")
    protocols = harness.window.protocol_panel.protocol
    for state, commands in ((State.IDLE, []), (State.HOLD, ["stop"])):
        harness.update(state=int(state))
        protocols.showPopup()
        press_escape(protocols.view())
        wait_until(lambda: not protocols.view().isVisible())
        assert harness.engine.commands == commands


def test_escape_in_an_open_list_stops_where_the_engine_was_lost(harness: Harness) -> None:
    harness.update(state=int(State.RUN))
    harness.engine.failure = LinkLost("the engine has ended")
    harness.window.poll()
    log = harness.window.event_log
    press_escape(_open_menu(harness.window))
    wait_until(lambda: "no engine is running" in log.toPlainText())
    log.clear()
    press_escape(_open_menu(harness.window))
    assert log.toPlainText() == "", "STOP was sent: nothing is known to move"


def test_escape_closes_the_file_browser_which_covers_nothing(harness: Harness) -> None:
    window = harness.window
    window.show_panel("protocol")
    for state, commands in ((State.IDLE, []), (State.HOLD, ["stop"])):
        harness.update(state=int(state))
        window.protocol_panel.out_button.click()
        dialog = window.file_browser.dialog
        assert dialog is not None and not dialog.isModal() and not dialog.isWindow()
        place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
        assert window.childAt(place) is window.toolbar.stop_button
        press_escape(dialog)
        assert harness.engine.commands == commands
        assert QApplication.activeModalWidget() is None
        assert window.file_browser.dialog is None


def test_escape_in_a_menu_ends_no_training_of_the_finger(finger: FingerWindow) -> None:
    finger.update(run=RUNNING)
    press_escape(_open_menu(finger.window))
    assert finger.engine.commands == []
    finger.window.close()  # asks
    assert finger.window.attach.closing.isVisible()
    press_escape(finger.window)
    assert not finger.window.attach.closing.isVisible() and finger.engine.commands == []
    press_escape(finger.window)
    assert finger.engine.commands == ["stop"]
    finger.update(run=asdict(FingerRunStatus()))


def test_a_prompt_leaves_stop_uncovered(harness: Harness) -> None:
    prompt = {"id": 3, "text": "Mount plate B, then confirm.", "texture": "B"}
    harness.update(run={"state": "prompt", "prompt": prompt})
    window = harness.window
    assert window.prompt_panel.isVisibleTo(window)
    place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
    assert window.childAt(place) is window.toolbar.stop_button


def test_unanswered_stop_is_reported(harness: Harness) -> None:
    harness.engine.replies = False
    click(harness.window.toolbar.stop_button)
    wait_until(lambda: "press the emergency stop" in harness.window.status_line.text())
    harness.engine.answer_all()
    harness.window.poll()
    assert "STOP reached virtual (process 1), " in harness.window.status_line.text()
    assert harness.window.status_line.text().endswith(" s after it was sent")


def test_stop_without_an_engine_is_reported(harness: Harness) -> None:
    click(harness.window.toolbar.connect_button)
    click(harness.window.toolbar.stop_button)
    wait_until(lambda: "no engine is running" in harness.window.status_line.text())
    assert "emergency stop if the drum moves" in harness.window.status_line.text()
    assert harness.engine.commands == []


def test_window_without_connection_stops_a_running_protocol(
    harness: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    click(harness.window.toolbar.connect_button)
    engine = start_protocol(tmp_path)
    try:
        press_escape(harness.window)
        text = f"STOP reached virtual (process {engine.engine_file.pid})"
        wait_until(lambda: harness.window.status_line.text() == text)
        ended = wait_ended(engine)
        assert (ended["state"], ended["text"]) == ("aborted", f"stopped by {client_name(WINDOW)}")
    finally:
        engine.shut_down()
    assert harness.engine.commands == []


def test_window_stops_its_own_engine_first_then_all_others(
    harness: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    write_engine_file(runtime_folder(), replace(harness.engine.engine_file, pid=os.getpid()))
    engine = start_protocol(tmp_path)
    try:
        click(harness.window.toolbar.stop_button)
        assert harness.engine.commands == ["stop"]
        wait_until(lambda: "STOP reached virtual" in harness.window.event_log.toPlainText())
        assert wait_ended(engine)["state"] == "aborted"
    finally:
        engine.shut_down()
    assert harness.engine.commands == ["stop"]
    assert "did not reach" not in harness.window.event_log.toPlainText()


def test_hanging_engine_is_reported_without_blocking_the_window(
    harness: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(client, "STOP_TIMEOUT_S", 0.2)
    with open_listener() as mute:
        port = mute.getsockname()[1]
        engine = EngineFile("mute", os.getpid(), port, "", "bench.toml", "")
        write_engine_file(runtime_folder(), engine)
        click(harness.window.toolbar.stop_button)
        assert harness.engine.commands == ["stop"]
        wait_until(lambda: "STOP did not reach bench.toml" in harness.window.status_line.text())
        assert "press its emergency stop" in harness.window.status_line.text()
