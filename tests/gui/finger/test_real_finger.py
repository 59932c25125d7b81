"""The tab Finger with a real engine and the virtual finger: calibrate, then name textures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.link.engine_link import JOIN
from gui.shell.main_window import MainWindow
from gui.widgets.labels import Level
from rigctl.engine.rpc.client import FINGER_ENGINE_COMMAND, EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.finger.models import train_models
from rigctl.finger.session import FingerSession
from tests.finger.harness import open_finger_harness
from tests.gui.steps import click, own_window, press_escape, wait_until

TIMEOUT_MS = 120_000
TWO_PLATES = """
name = "two-plates"
textures = ["A", "L"]
profiles = ["fast"]

[stages]
normalise = 1
train = 2
calibrate = 1
run = 20
"""


@pytest.fixture(scope="module")
def training(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a training session, recorded without a window."""
    folder = tmp_path_factory.mktemp("training")
    with open_finger_harness(folder) as harness:
        harness.record(harness.request("normalise", "train", protocol=TWO_PLATES))
        train_models(harness.session, 3, "2026-01-02T03:04:05+00:00")
        return harness.session


@pytest.fixture
def window(
    qapp: QApplication, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[MainWindow]:
    """Yield a window on its tab Finger."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "runtime"))
    with own_window() as window:
        window.show()
        window.show_panel("finger")
        yield window


def test_calibration_leads_to_answers_while_the_finger_moves(
    window: MainWindow, training: Path, tmp_path: Path
) -> None:
    tab = window.finger_tab
    setup, box, view = tab.setup, tab.run_box, tab.view
    setup.add_protocol(str(_protocol(tmp_path)))
    setup.choose_stage("calibrate")
    setup.model.setText(str(training))
    setup.out.setText(str(tmp_path))
    setup.seed.setValue(3)
    click(box.buttons["Start"])
    for _ in range(2):  # one question a plate
        wait_until(tab.prompt_panel.isVisible, TIMEOUT_MS)
        click(tab.prompt_panel.confirm)
        wait_until(lambda: not tab.prompt_panel.isVisible())
    wait_until(lambda: setup.stage.currentText() == "3 Run in real time", TIMEOUT_MS)
    calibrated = Path(setup.model.text())
    assert (calibrated / "model-speed-scaled.h5").is_file() and calibrated != training

    setup.unasked.setChecked(True)
    wait_until(box.buttons["Start"].isEnabled)
    click(box.buttons["Start"])
    wait_until(lambda: view.answer.state == "growing", TIMEOUT_MS)
    assert tab.bar.recording_display.lamp.level is Level.OK
    assert sum(view.bars.probabilities.values()) == pytest.approx(1)
    wait_until(lambda: view.answer.state in ("right", "wrong", "unknown"), TIMEOUT_MS)
    assert view.plots.raster.ticks.any(axis=1).all()
    assert len(view.plots.shown_velocities_mm_s) >= 5 and len(view.plate.path_mm) > 50
    own, curve = window.own_plots, tmp_path / "own.py"
    curve.write_text("def curves(block):\n    return {'spikes': (block.spikes.sum(), 'spikes')}\n")
    own.choose(str(curve))
    wait_until(lambda: own.isVisible() and len(own.plots.values.get("spikes", ())) > 100)
    click(own.back)
    assert view.isVisible()
    wait_until(lambda: tab.link.status.run.classified == 1, TIMEOUT_MS)
    assert view.confusion.accuracy.text().endswith("guessing 50\u202f%)")
    _pause_and_stop(window)


def _protocol(folder: Path) -> Path:
    path = folder / "two-plates.toml"
    path.write_text(TWO_PLATES)
    return path


def _pause_and_stop(window: MainWindow) -> None:
    """Pause and resume, then let STOP end the run; its session holds what the window painted."""
    tab = window.finger_tab
    click(tab.run_box.buttons["Pause"])
    wait_until(lambda: tab.link.status.run.state == "paused", TIMEOUT_MS)
    wait_until(tab.run_box.buttons["Resume"].isEnabled)
    click(tab.run_box.buttons["Resume"])
    wait_until(lambda: tab.link.status.run.state == "running", TIMEOUT_MS)
    press_escape(window)
    wait_until(lambda: tab.link.status.run.state == "aborted", TIMEOUT_MS)
    with FingerSession.open(Path(str(tab.link.status.run.session))) as session:
        assert session.committed().size >= 1
        kinds = session.latencies["kind"].tolist()
    assert kinds.count(b"screen") + kinds.count("screen") >= 5


def test_window_joins_a_run_and_takes_it_over(window: MainWindow, tmp_path: Path) -> None:
    stages = ["--stage", "normalise", "--protocol", str(_protocol(tmp_path)), "--yes"]
    folder = ["--out", str(tmp_path / "session")]
    client = EngineClient.start("virtual", run=stages + folder, command=FINGER_ENGINE_COMMAND)
    tab = window.finger_tab
    tab.bar.rig.setCurrentIndex(tab.bar.rig.findData(JOIN))
    click(tab.bar.connect_button)
    wait_until(lambda: tab.link.status.run.scan is not None, TIMEOUT_MS)
    assert tab.view.task.text().startswith("Plate ")
    client.close()
    wait_until(lambda: tab.link.status.run.trials_committed >= 1, TIMEOUT_MS)
    click(tab.run_box.buttons["Abort"])
    wait_until(lambda: tab.link.status.run.state == "aborted", TIMEOUT_MS)
    assert tab.run_box.state.text() == "Aborted by this window"
    click(tab.bar.connect_button)
    tab.link.wait_closed()
    assert client.process is not None and client.process.wait(30) == 0
