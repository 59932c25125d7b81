"""Connecting to an engine, losing it and leaving it."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication
from shiboken6 import delete

from gui.link.engine_link import JOIN, NOT_CONNECTED
from gui.shell.main_window import MainWindow
from gui.widgets.labels import Level
from rigctl.errors import LinkLost, WrongUse
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import Harness, SharedWindow, click, own_window, wait_until


def test_connect_button_opens_the_chosen_rig(disconnected: SharedWindow) -> None:
    window = disconnected.window
    window.toolbar.world.choose("")
    window.toolbar.rig.choose("firmware")
    click(window.toolbar.connect_button)
    assert window.toolbar.connect_button.text() == "Cancel"
    wait_until(lambda: window.engine_link.live is not None)
    assert disconnected.opened == [("firmware", "")]
    assert window.toolbar.connect_button.text() == "Disconnect"


def test_simulated_rig_is_opened_with_a_world_file(disconnected: SharedWindow) -> None:
    disconnected.error = WrongUse("lab.toml, line 1: top_gain: 9 is outside 0.5 to 1.5 1/mm")
    window, toolbar = disconnected.window, disconnected.window.toolbar
    toolbar.rig.choose("virtual")
    toolbar.world.setCurrentIndex(toolbar.world.count() - 1)
    toolbar.world.activated.emit(toolbar.world.count() - 1)
    assert window.file_browser.dialog is not None
    window.file_browser.dialog.fileSelected.emit("/home/lab/lab.toml")
    assert toolbar.world.currentText() == "lab.toml"
    click(toolbar.connect_button)
    wait_until(lambda: "line 1" in toolbar.state_words.text())
    assert disconnected.opened == [("virtual", "/home/lab/lab.toml")]
    assert toolbar.world.isEnabled()
    window.file_browser.dismiss()


def test_joined_engine_keeps_its_world(disconnected: SharedWindow) -> None:
    toolbar = disconnected.window.toolbar
    toolbar.world.choose("/home/lab/lab.toml")
    toolbar.rig.choose(JOIN)
    assert not toolbar.world.isVisible()
    click(toolbar.connect_button)
    wait_until(lambda: disconnected.window.engine_link.live is not None)
    assert disconnected.opened == [(JOIN, "")]


def test_failed_connection_shows_the_reason(disconnected: SharedWindow) -> None:
    reason = "port /dev/ttyACM0 is in use: close the other program"
    disconnected.error = WrongUse(reason)
    window = disconnected.window
    window.connect_rig("/etc/rig.toml")
    wait_until(lambda: "in use" in window.status_line.text())
    assert window.toolbar.connect_button.isEnabled()
    assert window.toolbar.state_words.text() == reason


def test_connecting_is_cancelled_and_an_engine_that_comes_late_is_left(
    qapp: QApplication, tmp_path: Path
) -> None:
    engine, gate = FakeEngine(tmp_path), threading.Event()

    def open_late(rig: str, world: str) -> FakeEngine:
        gate.wait(60)
        return engine

    window = MainWindow(open_late)
    window.show()
    button, words = window.toolbar.connect_button, window.toolbar.state_words
    click(button)
    wait_until(lambda: words.text().endswith(" s") and button.text() == "Cancel")
    first = words.text()
    wait_until(lambda: words.text() != first)  # a busy computer may skip a second
    assert words.text().endswith(" s")
    click(button)
    assert button.text() == "Connect" and words.text() == NOT_CONNECTED
    gate.set()
    wait_until(lambda: engine.is_closed)
    assert button.text() == "Connect" and not window.engine_link.is_connected
    window.close()
    delete(window)


def test_closing_during_connection_leaves_no_engine(qapp: QApplication, tmp_path: Path) -> None:
    engine = FakeEngine(tmp_path)
    with own_window(engine) as window:
        window.connect_rig("virtual")
    assert engine.is_closed


def test_end_of_the_engine_is_reported(harness: Harness) -> None:
    harness.update()
    harness.engine.failure = LinkLost("the engine ended (it closed the connection)")
    harness.window.poll()
    assert "the engine ended" in harness.window.status_line.text()
    assert harness.window.toolbar.connect_button.text() == "Connect"
    assert not any(button.isEnabled() for button in harness.window.operate_panel.buttons.values())


def test_silent_engine_turns_the_recording_lamp_bad(harness: Harness) -> None:
    harness.update(recording={"active": True, "samples_last_s": 1000, "folder": "/s"})
    assert harness.window.toolbar.recording_lamp.level is Level.OK
    wait_until(lambda: harness.window.toolbar.recording_lamp.level is Level.BAD)
    assert "does not answer" in harness.window.status_line.text()


@pytest.mark.parametrize(
    ("recording", "level", "title"),
    [
        ({"active": False, "folder": None}, Level.OFF, "Not recording"),
        ({"active": True, "samples_last_s": 998, "folder": "/s"}, Level.OK, "Recording"),
        ({"active": False, "samples_last_s": 0, "folder": "/s"}, Level.OFF, "Not recording"),
        ({"active": True, "failure": "disk full", "folder": "/s"}, Level.BAD, "NOT RECORDING"),
    ],
)
def test_recording_lamp_shows_the_recording(
    harness: Harness, recording: dict[str, object], level: Level, title: str
) -> None:
    harness.update(recording=recording)
    assert harness.window.toolbar.recording_lamp.level is level
    assert harness.window.toolbar.recording.text() == title


def test_run_without_recording_turns_the_lamp_bad(harness: Harness) -> None:
    for _ in range(20):
        harness.update(run={"state": "running"}, recording={"active": False, "folder": "/s"})
    assert harness.window.toolbar.recording_lamp.level is Level.BAD
    harness.update(run={"state": "prompt"})
    assert harness.window.toolbar.recording_lamp.level is Level.OFF


def test_disconnect_leaves_the_engine_to_its_other_clients(harness: Harness) -> None:
    """A second window that disconnected ended the engine under the first one."""
    click(harness.window.toolbar.connect_button)
    harness.window.engine_link.wait_closed()
    assert harness.engine.is_left


def test_a_run_may_end_before_the_window_closes(qapp: QApplication, tmp_path: Path) -> None:
    engine = FakeEngine(tmp_path)
    with own_window(engine) as window:
        window.show()
        window.connect_rig("virtual")
        wait_until(lambda: window.engine_link.live is not None)
        harness = Harness(window, engine)
        harness.update(run={"state": "running", "session": "/data/textures"})
        assert not window.close()
        assert "/data/textures" in window.attach.closing.text.text()
        click(window.attach.closing.stop)
        assert engine.commands == ["abort"] and window.isVisible()
        harness.update(run={"state": "aborted"})
        assert not window.isVisible() and engine.is_left
