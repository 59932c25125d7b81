"""``python -m gui.screenshots FOLDER``: the README's pictures, from a live virtual rig at work."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.acquisition.rpc.engine_files import FOLDER_VARIABLE
from rigctl.wire.drum.states import State

if TYPE_CHECKING:
    from gui.main_window import MainWindow

SIZES = ((1280, 800), (1920, 1080))
PROTOCOL = "quick"
RIDGES = """\
name = "ridges"
description = "Three ridged plates, for pictures."
textures = ["D", "I", "L"]
speeds_mm_s = [40, 60]
forces_g = [500]
repeats = 6
"""
LIMIT_S = 300.0
TRIALS_BEFORE = 3
RANGE_S = 2.0
SETTLING_MS = 1500  # layouts settle, and traces reach the new width
TABS = {"operate": 0, "protocol": 1, "analysis": 2}


def main(argv: list[str]) -> int:
    """Render everything into the folder; return the exit code."""
    if len(argv) != 1 or argv[0].startswith("-"):
        print("usage: python -m gui.screenshots FOLDER", file=sys.stderr)
        return 2
    os.environ["QT_QPA_PLATFORM"] = "offscreen"
    folder = Path(argv[0])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        os.environ[FOLDER_VARIABLE] = work
        session = record_session(Path(work) / "quick")
        take_all(folder, Path(work), session)
    return 0


def record_session(folder: Path) -> Path:
    """Record the quick protocol as fast as the virtual rig goes, for the Analysis picture."""
    from rigctl.acquisition.rpc.client import EngineClient

    order = ["--protocol", PROTOCOL, "--yes", "--out", str(folder)]
    client = EngineClient.start("virtual", paced=False, seed=1, run=order)
    try:
        states: list[str] = []
        while not states or states[-1] in ("idle", "running", "prompt", "paused"):
            told = [m for m in client.wait(LIMIT_S) if m.get("event") == "status"]
            states += [message["data"]["run"]["state"] for message in told]
    finally:
        client.shut_down()
    return folder


def take_all(folder: Path, work: Path, session: Path) -> None:
    """Run a protocol in a window and take its pictures."""
    import pyqtgraph as pg

    from gui.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    pg.mkQApp()
    window = MainWindow(choice=ThemeChoice.LIGHT)
    try:
        window.show()
        _begin_run(window, work)
        _take_live(window, folder)
        _take_analysis(window, folder, session)
    finally:
        window.connection.ask("abort")
        window.close()


def _begin_run(window: MainWindow, work: Path) -> None:
    """Connect, start the protocol, answer its questions until trials are on disk."""
    window.connect_rig("virtual")
    status = window.connection
    _wait(window, lambda: status.status.drum_connected and status.status.taxels_connected)
    window.protocol.set_out(str(work))
    ridges = work / "ridges.toml"
    ridges.write_text(RIDGES, encoding="utf-8")
    window.tabs.setCurrentIndex(TABS["protocol"])
    window.protocol.add_protocol(str(ridges))
    _wait(window, window.protocol.buttons["Start"].isEnabled)
    window.protocol.buttons["Start"].click()
    _wait(window, lambda: _go_on(window) and _is_turning(window))
    status.ask("calibrate_range", seconds=RANGE_S)
    _wait(window, lambda: _go_on(window) and status.status.run.trials_committed >= TRIALS_BEFORE)


def _go_on(window: MainWindow) -> bool:
    """Answer a question as soon as it is asked."""
    if window.connection.status.run.prompt is not None and window.prompt.isVisible():
        window.prompt.done.click()
    return True


def _take_live(window: MainWindow, folder: Path) -> None:
    """The Operate tab in both themes and sizes, the Protocol tab once."""
    from gui.widgets.theme import ThemeChoice

    def ready() -> bool:
        return _go_on(window) and _is_turning(window)

    window.resize(*SIZES[0])
    _save(window, folder / "protocol.png", ready)
    window.tabs.setCurrentIndex(TABS["operate"])
    for choice in (ThemeChoice.LIGHT, ThemeChoice.DARK):
        window.set_theme(choice)
        for width, height in SIZES:
            window.resize(width, height)
            _save(window, folder / f"window-{choice.name.lower()}-{width}x{height}.png", ready)


def _is_turning(window: MainWindow) -> bool:
    """The drum turns under force at its set speed."""
    status = window.connection.status
    return status.state is State.RUN and status.speed_mm_s > 0.99 * status.speed_set_mm_s


def _take_analysis(window: MainWindow, folder: Path, session: Path) -> None:
    """A trial of the recorded session, and what the classification drew."""
    from gui.widgets.theme import ThemeChoice

    panel = window.analysis.panel

    def idle() -> bool:
        return not window.analysis.worker.is_busy

    window.tabs.setCurrentIndex(TABS["analysis"])
    panel.choose(str(session))
    _wait(window, lambda: idle() and window.analysis.trial_view.data is not None)
    panel.table.selectRow(panel.model.rowCount() // 2)
    _wait(window, idle)
    panel.box.run.click()
    _wait(window, idle)
    window.set_theme(ThemeChoice.LIGHT)
    window.resize(*SIZES[0])
    _save(window, folder / "classified.png")
    panel.table.selectRow(panel.model.rowCount() // 2 + 1)
    _wait(window, idle)
    _save(window, folder / "analysis.png")


def _save(window: MainWindow, path: Path, ready: Callable[[], bool] = lambda: True) -> None:
    from PySide6.QtTest import QTest

    QTest.qWait(SETTLING_MS)
    _wait(window, ready)
    if not window.grab().save(str(path)):
        raise SystemExit(f"{path} cannot be written: choose another folder")
    print(path, flush=True)


def _wait(window: MainWindow, done: Callable[[], bool]) -> None:
    from PySide6.QtTest import QTest

    end_s = time.monotonic() + LIMIT_S
    while not done():
        if time.monotonic() > end_s:
            raise SystemExit(f"the rig did not get there:\n{window.log.toPlainText()}")
        QTest.qWait(30)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
