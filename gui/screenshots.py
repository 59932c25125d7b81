"""``python -m gui.screenshots FOLDER``: render the README's images from a live virtual rig."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pyqtgraph as pg
from PySide6.QtTest import QTest

from gui.finger.scan_record import AnswerState
from gui.shell.main_window import MainWindow
from gui.widgets.theme import ThemeChoice
from rigctl.acquisition.rpc.runtime_folder import FOLDER_VARIABLE
from rigctl.wire.drum.states import State

SIZES = ((1280, 800), (1920, 1080))
RIDGES = """\
name = "ridges"
description = "Three ridged plates, for pictures."
textures = ["D", "I", "L"]
speeds_mm_s = [40, 60]
forces_g = [500]
repeats = 6
"""
TIMEOUT_S = 300.0
MIN_TRIALS = 3
CALIBRATION_S = 2.0
SETTLING_MS = 1500  # until layouts and traces have the new width
FINGER_SEED = "1"
MIN_NAMED, MIN_WINDOWS = 4, 9


def main(argv: list[str]) -> int:
    """Render all images into the folder; return the exit code."""
    if len(argv) != 1 or argv[0].startswith("-"):
        print("usage: python -m gui.screenshots FOLDER", file=sys.stderr)
        return 2
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    folder = Path(argv[0])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        os.environ[FOLDER_VARIABLE] = work
        session = Path(work) / "quick"
        _rigctl("run", "quick", "--yes", "--seed", "1", "--out", str(session))
        render_all(folder, Path(work), session, _calibrated(Path(work)))
    return 0


def _rigctl(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "rigctl", *words], check=True)


def _calibrated(work: Path) -> Path:
    """Train and calibrate the finger's models; return the calibration's folder."""
    training, calibration = work / "finger-train", work / "finger-calibrate"
    common = ("--protocol", "quick", "--yes", "--seed", FINGER_SEED, "--out")
    _rigctl("realtime", "train", *common, str(training))
    _rigctl("realtime", "calibrate", *common, str(calibration), "--model", str(training))
    return calibration


def render_all(folder: Path, work: Path, session: Path, model: Path) -> None:
    """Run protocols in a window and render the images; ``model``: folder of the finger's."""
    pg.mkQApp()
    window = MainWindow(choice=ThemeChoice.LIGHT)
    try:
        window.show()
        _start_run(window, work)
        _render_live(window, folder)
        _render_analysis(window, folder, session)
        window.engine_link.request("abort")
        _render_finger(window, folder, work, model)
    finally:
        for link in (window.engine_link, window.finger_tab.link):
            if link.is_connected:
                link.request("abort")
        window.close()


def _start_run(window: MainWindow, work: Path) -> None:
    """Connect, start the protocol and confirm its prompts until some trials are on disk."""
    window.connect_rig("virtual")
    link, panel = window.engine_link, window.protocol_panel
    _wait(window, lambda: link.status.drum_connected and link.status.taxels_connected)
    panel.out.setText(str(work))
    ridges = work / "ridges.toml"
    ridges.write_text(RIDGES, encoding="utf-8")
    window.show_panel("protocol")
    panel.add_protocol(str(ridges))
    _wait(window, panel.buttons["Start"].isEnabled)
    panel.buttons["Start"].click()
    _wait(window, lambda: _advance_run(window))
    link.request("calibrate_range", seconds=CALIBRATION_S)
    _wait(window, lambda: _advance_run(window) and link.status.run.trials_committed >= MIN_TRIALS)


def _advance_run(window: MainWindow) -> bool:
    """Confirm a prompt, if any; return whether the drum turns under force at its set speed."""
    status = window.engine_link.status
    if status.run.prompt is not None and window.prompt_panel.isVisible():
        window.prompt_panel.confirm.click()
    return status.state is State.RUN and status.speed_mm_s > 0.99 * status.speed_set_mm_s


def _render_live(window: MainWindow, folder: Path) -> None:
    """Render the Operate tab in both themes and sizes, and the Protocol tab once."""
    window.resize(*SIZES[0])
    _save(window, folder / "protocol.png", lambda: _advance_run(window))
    window.show_panel("operate")
    for choice in (ThemeChoice.LIGHT, ThemeChoice.DARK):
        window.set_theme(choice)
        for width, height in SIZES:
            window.resize(width, height)
            name = f"window-{choice.name.lower()}-{width}x{height}.png"
            _save(window, folder / name, lambda: _advance_run(window))


def _render_analysis(window: MainWindow, folder: Path, session: Path) -> None:
    """Render a trial of the recorded session, and the figure of the quick check."""
    tab, panel = window.analysis_tab, window.analysis_tab.panel

    def wait_idle() -> None:
        _wait(window, lambda: not (tab.worker.is_busy or tab.reader.is_busy))

    window.show_panel("analysis")
    panel.open_session(str(session))
    wait_idle()
    panel.table.selectRow(panel.model.rowCount() // 2)
    wait_idle()
    panel.run_box.run_button.click()
    wait_idle()
    window.set_theme(ThemeChoice.LIGHT)
    window.resize(*SIZES[0])
    _save(window, folder / "classified.png")
    panel.table.selectRow(panel.model.rowCount() // 2 + 1)
    wait_idle()
    _save(window, folder / "analysis.png")


def _render_finger(window: MainWindow, folder: Path, work: Path, model: Path) -> None:
    """Render a right and a growing answer in both themes and sizes.

    Every image has a run of its own: a change of the theme delays its answers.
    """
    setup = window.finger_tab.setup
    window.show_panel("finger")
    setup.choose_stage("run")
    setup.model.setText(str(model))
    setup.out.setText(str(work))
    setup.seed.setValue(int(FINGER_SEED))
    setup.unasked.setChecked(True)
    for choice in (ThemeChoice.LIGHT, ThemeChoice.DARK):
        window.set_theme(choice)
        for (width, height), ready in zip(SIZES, (_is_right, _grows), strict=True):
            window.resize(width, height)
            _run_finger(window)
            name = f"finger-{choice.name.lower()}-{width}x{height}.png"
            _save(window, folder / name, partial(ready, window))


def _run_finger(window: MainWindow) -> None:
    """Run the real-time stage on a new engine until some scans are named."""
    tab = window.finger_tab
    if tab.link.is_connected:
        tab.link.request("abort")
        _wait(window, lambda: tab.link.status.run.has_ended)
        tab.link.close()
    _wait(window, tab.run_box.buttons["Start"].isEnabled)
    tab.run_box.buttons["Start"].click()
    _wait(window, lambda: tab.link.status.run.classified >= MIN_NAMED)


def _is_right(window: MainWindow) -> bool:
    return window.finger_tab.view.record.state is AnswerState.RIGHT


def _grows(window: MainWindow) -> bool:
    record = window.finger_tab.view.record
    row = record.prediction
    return record.state is AnswerState.GROWING and row is not None and row.windows >= MIN_WINDOWS


def _save(window: MainWindow, path: Path, ready: Callable[[], bool] = lambda: True) -> None:
    QTest.qWait(SETTLING_MS)
    _wait(window, ready)
    if not window.grab().save(str(path)):
        raise SystemExit(f"{path} is not writable: choose another folder")
    print(path, flush=True)


def _wait(window: MainWindow, done: Callable[[], bool]) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not done():
        if time.monotonic() > end_s:
            log = window.event_log.toPlainText()
            raise SystemExit(f"the rig did not reach the expected state:\n{log}")
        QTest.qWait(30)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
