"""The panel Finger on another computer: a growing session is followed, an engine is forwarded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication
from shiboken6 import delete

from gui.engine_clients import experiment_elsewhere, followed_session, remote_engine
from gui.shell.main_window import MainWindow
from rigctl.acquisition.rpc.client import FINGER_ENGINE_COMMAND, EngineClient
from rigctl.acquisition.rpc.engine_files import FINGER_EXPERIMENT, write_engine_file
from rigctl.acquisition.rpc.runtime_folder import FOLDER_VARIABLE
from rigctl.realtime.live_file import FingerLiveReader
from rigctl.session.finger_session import FingerSession
from tests.gui.forwarded_socket import forwarded
from tests.gui.steps import click, press_escape, wait_until

TIMEOUT_MS = 60_000
LONG = """
name = "long"
textures = ["A", "L"]
profiles = ["medium", "fast"]

[stages]
normalise = 200
train = 0
calibrate = 0
run = 0

[quality]
fast_min_mm_s = 131.0
"""


@pytest.fixture(scope="module")
def running(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[EngineClient]:
    """Yield a client of an engine of the virtual finger whose run goes on."""
    folder = tmp_path_factory.mktemp("finger")
    (folder / "long.toml").write_text(LONG)
    words = ["--stage", "normalise", "--protocol", str(folder / "long.toml"), "--yes"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER_VARIABLE, str(folder))
        out = ["--out", str(folder / "session")]
        engine = EngineClient.start("virtual", run=words + out, command=FINGER_ENGINE_COMMAND)
        while engine.request("status")["run"]["trials_committed"] < 1:
            pass
        yield engine
        engine.request("take_control")
        engine.shut_down()


@pytest.fixture
def window(running: EngineClient) -> Iterator[MainWindow]:
    """Yield a window of a small screen on its panel Finger."""
    window = MainWindow()
    window.resize(1024, 700)
    window.show()
    window.show_panel("finger")
    yield window
    window.attach.leave()
    delete(window)


def test_a_growing_session_of_the_finger_is_followed(
    running: EngineClient, window: MainWindow
) -> None:
    folder = running.request("status")["run"]["session"]
    rig = followed_session(folder)
    assert experiment_elsewhere(rig) == FINGER_EXPERIMENT
    tab, view = window.finger_tab, window.finger_tab.view
    tab.connect_rig(rig)
    wait_until(lambda: tab.link.live is not None and tab.link.live.taxel_head > 1000, TIMEOUT_MS)
    committed = tab.link.status.run.trials_committed
    wait_until(lambda: tab.link.status.run.trials_committed > committed, TIMEOUT_MS)
    wait_until(lambda: len(view.plots.shown_velocities_mm_s) >= 5, TIMEOUT_MS)
    window.event_log.clear()
    wait_until(lambda: "slide over the plate" in window.event_log.toPlainText(), TIMEOUT_MS)
    wait_until(lambda: len(view.plate.path_mm) > 20, TIMEOUT_MS)
    assert view.plots.quality.fast_min_mm_s == 131.0
    wait_until(lambda: bool(view.plots.raster.ticks.any()), TIMEOUT_MS)
    wait_until(lambda: view.task.text().startswith("Plate "), TIMEOUT_MS)
    wait_until(lambda: tab.link.status.recording.active, TIMEOUT_MS)
    wait_until(lambda: tab.link.status.finger_connected, TIMEOUT_MS)
    strip = window.attach.controls[1]
    assert "Nothing here reaches the rig" in strip.text.text()
    for button in (*tab.run_box.buttons.values(), tab.run_box.models_button):
        assert not button.isEnabled() and "nothing here reaches the rig" in button.toolTip()
    press_escape(window)
    wait_until(lambda: "STOP does not reach the rig" in window.event_log.toPlainText())
    wait_until(lambda: running.request("status")["run"]["state"] == "aborted", TIMEOUT_MS)


def test_an_engine_of_the_finger_on_another_computer(
    running: EngineClient, window: MainWindow, tmp_path: Path
) -> None:
    """On loopback: the engine's file is a copy, its socket is forwarded, its memory is not."""
    engine = running.engine_file
    copy = write_engine_file(tmp_path, replace(engine, live="/on/the/other/computer.live"))
    own = FingerLiveReader(Path(engine.live))
    with forwarded(tmp_path / f"{engine.name}.sock", engine.socket):
        rig = remote_engine(str(copy))
        assert experiment_elsewhere(rig) == FINGER_EXPERIMENT
        tab = window.finger_tab
        tab.connect_rig(rig)
        link = tab.link
        wait_until(lambda: link.live is not None and link.live.taxel_head > 1000, TIMEOUT_MS)
        assert link.live is not None and link.is_elsewhere
        seen = link.live.taxels(500)
        there = own.taxels(30_000)
        rows = [int(i) for i in (seen.counters - there.counters[0])]
        assert seen.samples.tolist() == there.samples[rows].tolist()
        assert seen.spikes.tolist() == there.spikes[rows].tolist()
        wait_until(lambda: window.attach.shared[1].number > 0, TIMEOUT_MS)
        click(window.attach.controls[1].take)
        wait_until(lambda: window.attach.shared[1].has_control)
        link.request("abort")
        wait_until(lambda: not link.status.run.is_active, TIMEOUT_MS)
        out = str(tmp_path / "s")
        protocol = _protocol(running)
        link.request("start", stages=["normalise"], protocol=protocol, out=out, yes=True)
        wait_until(lambda: link.status.run.session == out, TIMEOUT_MS)
        wait_until(lambda: link.status.run.trials_committed > 0, TIMEOUT_MS)
        wait_until(tab.run_box.buttons["Pause"].isEnabled)
        click(tab.run_box.buttons["Pause"])
        wait_until(lambda: link.status.run.state == "paused", TIMEOUT_MS)
        press_escape(window)
        wait_until(lambda: link.status.run.state == "aborted", TIMEOUT_MS)
        assert not tab.worker.is_busy
        click(tab.run_box.models_button)
        assert "in a window there" in tab.run_box.models.text()
        link.close()
        link.wait_closed()
    own.close()
    with FingerSession.open(tmp_path / "s") as session:
        assert session.committed().size >= 1
        assert "screen" not in session.latencies["kind"].tolist()


def _protocol(running: EngineClient) -> str:
    return str(Path(running.engine_file.live).parents[1] / "long.toml")
