"""Benchmark the live plots: time of a redraw, and age of a sample on the screen."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rigctl.acquisition.rpc.runtime_folder import FOLDER_VARIABLE

if TYPE_CHECKING:
    from gui.main_window import MainWindow

SIZE = (1400, 900)
SAMPLES_A_FRAME = 33
FRAMES = 600
WARM_UP = 40
SPIKES_A_SAMPLE = 0.08
SECONDS = 20.0
REDRAW_NOTE = (
    "offscreen raster engine, 1400x900, one CPU core: force, speed, 18 traces, 36-row raster "
    "of 10 s at 80 spikes/s a row, heat map, rates; pull, preparation and painting"
)
AGE_NOTE = (
    "virtual rig in real time in its engine's process; from a sample's time at the host to the "
    "end of the paint event that shows it, 30 redraws a second, window 1400x900 offscreen"
)


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``live.redraw_ms_p50``, ``live.redraw_ms_p99``, ``live.sample_to_pixel_ms_p99``."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    costs_ms = redraw_costs_ms()
    yield _row("live.redraw_ms_p50", np.percentile(costs_ms, 50), REDRAW_NOTE)
    yield _row("live.redraw_ms_p99", np.percentile(costs_ms, 99), REDRAW_NOTE)
    yield _row("live.sample_to_pixel_ms_p99", np.percentile(ages_ms(), 99), AGE_NOTE)


def _row(name: str, value: np.floating[Any], note: str) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(float(value), 2),
        "unit": "ms",
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "note": note,
    }


def ages_ms(seconds: float = SECONDS) -> list[float]:
    """Return the age of every sample when a window painted it, on a virtual rig in real time.

    The fastest status message gives the offset of the engine's clock, so an age is too long by
    at most the latency of that message.
    """
    import pyqtgraph as pg
    from PySide6.QtCore import QTimer
    from PySide6.QtTest import QTest

    from gui.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    pg.mkQApp()
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = folder
        window = MainWindow(choice=ThemeChoice.LIGHT)
        window.resize(*SIZE)
        window.show()
        ages = _SampleAges(window)
        window.timer.timeout.connect(lambda: QTimer.singleShot(0, ages.on_paint))
        window.engine_link.status_changed.connect(lambda status: ages.on_status(status.at_s))
        window.connect_rig("virtual")
        while not ages.offsets_s:
            QTest.qWait(50)
        QTest.qWait(round(1000 * seconds))
        window.close()
    return ages.ages_ms()


class _SampleAges:
    """Collects when each sample arrived and when it was painted."""

    def __init__(self, window: MainWindow) -> None:
        self._plots = window.live_plots
        self._seen_s = 0.0
        self._painted: list[tuple[float, float, float]] = []
        self.offsets_s: list[float] = []

    def on_status(self, at_s: float) -> None:
        """Store the clock offset of a status of engine time ``at_s``."""
        self.offsets_s.append(time.monotonic() - at_s)

    def on_paint(self) -> None:
        """Store the time at which the samples of the history are on the screen."""
        newest_s = self._plots.history.newest_s
        if newest_s > self._seen_s > 0 and self.offsets_s:
            self._painted.append((self._seen_s, newest_s, time.monotonic()))
        self._seen_s = newest_s

    def ages_ms(self) -> list[float]:
        """Return the ages of all samples except those of the first second."""
        offset_s = min(self.offsets_s)
        times = [
            at_s - offset_s - np.arange(newest_s, seen_s, -0.001)
            for seen_s, newest_s, at_s in self._painted[30:]
        ]
        return [1000 * float(age) for age in np.concatenate(times)]


def redraw_costs_ms(frames: int = FRAMES) -> list[float]:
    """Return the wall time of each redraw, which reads new samples, prepares and paints them."""
    import pyqtgraph as pg

    from gui.live.live_plots import LivePlots
    from gui.widgets.theme import ThemeChoice, apply_theme
    from tests.gui.fake_engine import FakeEngine

    app = pg.mkQApp()
    light = apply_theme(ThemeChoice.LIGHT)
    with tempfile.TemporaryDirectory() as folder:
        engine = FakeEngine(Path(folder))
        engine.write_samples(11_000, SPIKES_A_SAMPLE)
        scene = LivePlots(light)
        scene.resize(*SIZE)
        scene.show()
        costs_ms = []
        for _ in range(frames + WARM_UP):
            engine.write_samples(SAMPLES_A_FRAME, SPIKES_A_SAMPLE)
            began_s = time.perf_counter()
            scene.refresh(engine.live)
            app.processEvents()
            costs_ms.append(1000 * (time.perf_counter() - began_s))
        scene.hide()
        engine.close()
    return costs_ms[WARM_UP:]
