"""STOP works by mouse and by Esc with every focus and in every view."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QApplication, QMenu

from rigctl.boards.drum_states import State
from rigctl.engine.rpc import client
from rigctl.engine.rpc.client import WINDOW, client_name
from rigctl.engine.rpc.engine_files import (
    FOLDER_VARIABLE,
    EngineFile,
    runtime_folder,
    write_engine_file,
)
from rigctl.engine.rpc.server import open_listener
from tests.gui.running_engine import start_protocol, wait_ended
from tests.gui.steps import Harness, click, press_escape, wait_until


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


def test_escape_stops_and_closes_an_open_menu(harness: Harness) -> None:
    menu = harness.window.menuBar().findChild(QMenu)
    assert menu is not None
    menu.popup(harness.window.mapToGlobal(QPoint(5, 30)))
    wait_until(menu.isVisible)
    press_escape(menu)
    assert harness.engine.commands == ["stop"]
    assert not menu.isVisible()


def test_escape_stops_from_an_open_list(harness: Harness) -> None:
    harness.update()
    plate = harness.window.operate_panel.bench.plate
    plate.showPopup()
    press_escape(plate.view())
    plate.hidePopup()
    assert set(harness.engine.commands) == {"stop"}


def test_escape_stops_from_the_file_browser_which_covers_nothing(harness: Harness) -> None:
    window = harness.window
    window.show_panel("protocol")
    window.protocol_panel.out_button.click()
    dialog = window.file_browser.dialog
    assert dialog is not None and not dialog.isModal() and not dialog.isWindow()
    press_escape(dialog)
    assert harness.engine.commands == ["stop"]
    assert QApplication.activeModalWidget() is None
    place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
    assert window.childAt(place) is window.toolbar.stop_button
    window.file_browser.dismiss()


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
