"""An engine that a window has joined dies: Connect then does what the window says of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.link.engine_link import JOIN
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder
from rigctl.engine.rpc.messages import DISCONNECTED_TEXT
from rigctl.errors import LinkLost
from tests.gui.rig_window import opened_window
from tests.gui.steps import FingerWindow, Harness, click, wait_until


def test_connect_starts_the_rig_and_world_of_the_engine_that_was_joined(
    qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It said that no engine is running, and to choose a rig."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    world = tmp_path / "soft.toml"
    world.write_text("base_height_mm = 1.0\n")
    engine = EngineClient.start("virtual", paced=True, run=["--world", str(world)])
    with opened_window() as opened:
        window = opened.window
        window.toolbar.world.choose("/elsewhere/other.toml")
        opened.connect(JOIN)
        assert engine.process is not None
        engine.process.kill()
        engine.process.wait()
        strip = window.drum.alarms.strip
        opened.until(strip.isVisible)
        assert "Connect starts it again" in strip.text.text()
        assert window.toolbar.chosen_world == str(world)
        click(window.toolbar.connect_button)
        opened.until(lambda: opened.status.drum_connected)
        (started,) = running_engines(runtime_folder())
        assert (started.rig, started.world) == ("virtual", str(world))
        assert strip.isHidden()
    engine.close()


def test_a_rig_that_was_chosen_stays_chosen(harness: Harness) -> None:
    toolbar = harness.window.toolbar
    toolbar.rig.choose("/lab/rig.toml")
    harness.engine.failure = LinkLost("the engine ended (it closed the connection)")
    harness.window.poll()
    assert toolbar.rig.currentData() == "/lab/rig.toml"


def test_an_engine_that_goes_on_is_joined_again(harness: Harness) -> None:
    toolbar = harness.window.toolbar
    toolbar.rig.choose(JOIN)
    harness.update()
    harness.engine.failure = LinkLost(DISCONNECTED_TEXT)
    harness.window.poll()
    assert toolbar.rig.currentData() == JOIN
    assert "join it again" in harness.window.drum.alarms.strip.text.text()


def test_the_finger_bar_offers_the_rig_of_a_joined_engine(finger: FingerWindow) -> None:
    finger.tab.bar.rig.choose(JOIN)
    finger.engine.failure = LinkLost("the engine ended (connection broken): start it again")
    finger.window.poll()
    wait_until(lambda: not finger.tab.link.is_connected)
    assert finger.tab.bar.rig.currentData() == "virtual"
