"""STOP works always: by mouse, by Esc, whatever has the focus, whatever is shown."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QApplication, QMenu

from rigctl.acquisition.rpc import stop_all
from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.engine_files import (
    FOLDER_VARIABLE,
    EngineFile,
    announce,
    runtime_folder,
)
from rigctl.acquisition.rpc.server import listen
from rigctl.wire.drum.states import State
from tests.gui.steps import Bench, click, press_escape, wait_until

LONG = """
name = "long"
textures = ["A"]
speeds_mm_s = [40]
forces_g = [500]
repeats = 500
"""


def test_the_button_stops(bench: Bench) -> None:
    click(bench.window.toolbar.stop_button)
    assert bench.engine.commands == ["stop"]


def test_it_can_be_pressed_in_every_state(bench: Bench) -> None:
    for state in State:
        bench.see(state=int(state))
        click(bench.window.toolbar.stop_button)
    assert bench.engine.commands == ["stop"] * len(State)


def test_escape_stops_from_a_spin_box(bench: Bench) -> None:
    box = bench.window.operate_panel.speed
    box.setFocus()
    press_escape(box)
    assert bench.engine.commands == ["stop"]


def test_escape_stops_from_a_text_field_and_a_list(bench: Bench) -> None:
    bench.window.tabs.setCurrentIndex(1)
    press_escape(bench.window.protocol_panel.out)
    press_escape(bench.window.protocol_panel.protocol)
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
    plate = bench.window.operate_panel.bench.plate
    plate.showPopup()
    press_escape(plate.view())
    plate.hidePopup()
    assert set(bench.engine.commands) == {"stop"}


def test_escape_stops_from_the_file_chooser_which_covers_nothing(bench: Bench) -> None:
    window = bench.window
    window.tabs.setCurrentIndex(1)
    window.protocol_panel.out_button.click()
    dialog = window.file_browser.dialog
    assert dialog is not None and not dialog.isModal() and not dialog.isWindow()
    press_escape(dialog)
    assert bench.engine.commands == ["stop"]
    assert QApplication.activeModalWidget() is None
    place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
    assert window.childAt(place) is window.toolbar.stop_button
    window.file_browser.dismiss()


def test_a_prompt_leaves_stop_uncovered(bench: Bench) -> None:
    prompt = {"id": 3, "text": "Mount plate B, then confirm.", "texture": "B"}
    bench.see(run={"state": "prompt", "prompt": prompt})
    window = bench.window
    assert window.prompt_panel.isVisibleTo(window)
    place = window.toolbar.stop_button.mapTo(window, window.toolbar.stop_button.rect().center())
    assert window.childAt(place) is window.toolbar.stop_button


def test_an_engine_that_does_not_answer_stop_is_reported(bench: Bench) -> None:
    bench.engine.answers = False
    click(bench.window.toolbar.stop_button)
    wait_until(lambda: "press the emergency stop" in bench.window.status_line.text())


def test_stop_where_nothing_runs_says_so(bench: Bench) -> None:
    click(bench.window.toolbar.connect_button)
    click(bench.window.toolbar.stop_button)
    wait_until(lambda: "no engine is running" in bench.window.status_line.text())
    assert "emergency stop if the drum moves" in bench.window.status_line.text()
    assert bench.engine.commands == []


def test_a_window_that_joined_none_stops_a_protocol_that_runs(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    click(bench.window.toolbar.connect_button)
    engine = protocol_running(tmp_path)
    try:
        press_escape(bench.window)
        said = f"STOP reached virtual (process {engine.announcement.pid})"
        wait_until(lambda: bench.window.status_line.text() == said)
        assert ended(engine)["state"] == "aborted"
    finally:
        engine.shut_down()
    assert bench.engine.commands == []


def test_a_window_with_a_rig_stops_it_first_and_every_other_engine_too(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    announce(runtime_folder(), replace(bench.engine.announcement, pid=os.getpid()))
    engine = protocol_running(tmp_path)
    try:
        click(bench.window.toolbar.stop_button)
        assert bench.engine.commands == ["stop"]
        wait_until(lambda: "STOP reached virtual" in bench.window.event_log.toPlainText())
        assert ended(engine)["state"] == "aborted"
    finally:
        engine.shut_down()
    assert bench.engine.commands == ["stop"]
    assert "did not reach" not in bench.window.event_log.toPlainText()


def test_an_engine_that_hangs_is_told_of_and_the_window_goes_on(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    monkeypatch.setattr(stop_all, "ANSWER_S", 0.2)
    with listen() as mute:
        port = mute.getsockname()[1]
        engine = EngineFile("mute", os.getpid(), port, "", "bench.toml", "")
        announce(runtime_folder(), engine)
        click(bench.window.toolbar.stop_button)
        assert bench.engine.commands == ["stop"]
        wait_until(lambda: "STOP did not reach bench.toml" in bench.window.status_line.text())
        assert "press its emergency stop" in bench.window.status_line.text()


def protocol_running(folder: Path) -> EngineClient:
    """An engine of somebody else that is in the middle of a protocol."""
    protocol = folder / "long.toml"
    protocol.write_text(LONG)
    words = ["--protocol", str(protocol), "--out", str(folder / "session"), "--yes"]
    engine = EngineClient.start("virtual", paced=True, run=words)
    while engine.request("status")["run"]["state"] != "running":
        pass
    return engine


def ended(engine: EngineClient) -> dict[str, Any]:
    """The run as it ended."""
    while (run := engine.request("status")["run"])["state"] not in ("done", "aborted", "failed"):
        pass
    return dict(run)
