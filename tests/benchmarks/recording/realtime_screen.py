"""Benchmark the moving finger on the screen: from a velocity to the painted answer."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.engine.rpc.client import FINGER_ENGINE_COMMAND, EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from tests.benchmarks.recording.realtime import LINK, PROTOCOL, calibrated_model, figure
from tests.finger.harness import open_finger_session

SIZE = (1400, 900)
SECONDS = 120.0
NOTE = (
    "virtual finger in real time in its engine's process, window 1400x900 offscreen; from the "
    f"sending of a velocity to the window's report that it has painted the answer; {LINK}"
)


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``realtime.screen_ms_p99`` and ``realtime.screen_ms_p999``."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    with tempfile.TemporaryDirectory() as folder:
        ms = screen_latencies_ms(Path(folder))
    note = f"{NOTE}; {len(ms)} answers"
    yield figure("realtime.screen_ms_p99", float(np.percentile(ms, 99)), "ms", 50.0, note)
    yield figure("realtime.screen_ms_p999", float(np.percentile(ms, 99.9)), "ms", 100.0, note)


def screen_latencies_ms(folder: Path) -> NDArray[np.float64]:
    """Run for two minutes before a window; return the latencies that the session has, ms."""
    import pyqtgraph as pg
    from PySide6.QtTest import QTest

    from gui.link.engine_link import JOIN
    from gui.shell.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    model = calibrated_model(folder)
    pg.mkQApp()
    os.environ[FOLDER_VARIABLE] = str(folder)
    words = ["--stage", "run", "--session", "1", "--yes", "--model", str(model)]
    words += ["--protocol", _long_protocol(folder), "--out", str(folder / "run")]
    client = EngineClient.start("virtual", paced=True, run=words, command=FINGER_ENGINE_COMMAND)
    window = MainWindow(choice=ThemeChoice.LIGHT)
    try:
        window.resize(*SIZE)
        window.show()
        window.show_panel("finger")
        window.finger_tab.connect_rig(JOIN)
        end_s = time.monotonic() + SECONDS
        while time.monotonic() < end_s:
            QTest.qWait(100)
            client.drain()
        client.request("abort")
        while window.finger_tab.link.status.run.is_active:  # it would ask before it closes
            QTest.qWait(100)
    finally:
        window.close()
        client.shut_down()
    with open_finger_session(folder / "run") as session:
        latencies = session.latencies
        ms: NDArray[np.float64] = latencies["ms"][latencies["kind"] == "screen"]
    return ms


def _long_protocol(folder: Path) -> str:
    path = folder / "long.toml"
    path.write_text(PROTOCOL.replace("run = 1", "run = 20"), encoding="utf-8")
    return str(path)
