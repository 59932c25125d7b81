"""Benchmark the live plots beside plain pyqtgraph, and the age of a sample on the screen."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rigctl.acquisition.rpc.runtime_folder import FOLDER_VARIABLE
from tests.benchmarks.recording._plain_plots import plain_costs_ms

if TYPE_CHECKING:
    from gui.shell.main_window import MainWindow

SIZE = (1400, 900)
SAMPLES_A_FRAME = 33
FRAMES = 600
MINUTES_BACK = 11
SCROLLED_SAMPLES = 1000
"""A frame: 600 of them go back through ten minutes."""
WARM_UP = 40
SPIKES_A_SAMPLE = 0.08
SECONDS = 20.0
REDRAW_NOTE = (
    "offscreen raster engine, 1400x900, one CPU core: force, speed, 18 traces, 36-row raster "
    "of 10 s at 80 spikes/s a row, heat map, rates; pull, preparation and painting"
)
BACK_NOTE = (
    "the same views and samples that go on to arrive, while 600 frames scroll back by 1 s each"
)
AGE_NOTE = (
    "virtual rig in real time in its engine's process; from a sample's time at the host to the "
    "end of the paint event that shows it, a redraw for each block of samples, window 1400x900 "
    "offscreen"
)


def measure() -> Iterator[dict[str, Any]]:
    """Yield the redraw of the live plots and of plain pyqtgraph, and the age of a sample."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    ours, plain = redraw_costs_ms(), plain_costs_ms(FRAMES)
    for percent, limit in ((50, 3.0), (99, 6.0)):
        yield _row(f"live.redraw_ms_p{percent}", ours.live, percent, REDRAW_NOTE, plain, limit)
    yield _row("live.scroll_back_ms_p99", ours.back, 99, BACK_NOTE, None, 16.0)
    yield _row("live.sample_to_pixel_ms_p99", ages_ms(), 99, AGE_NOTE, None, 50.0)


def _row(
    name: str, ms: list[float], percent: int, note: str, plain: list[float] | None, target: float
) -> dict[str, Any]:
    value = round(float(np.percentile(ms, percent)), 2)
    peer = None if plain is None else round(float(np.percentile(plain, percent)), 2)
    return {
        "name": name,
        "value": value,
        "unit": "ms",
        "peer": None if peer is None else "pyqtgraph: PlotItem curves, ScatterPlotItem raster",
        "peer_value": peer,
        "ratio": None if peer is None else round(peer / value, 1),
        "note": f"target {target:g} ms; {note}",
    }


def ages_ms(seconds: float = SECONDS) -> list[float]:
    """Return the age of every sample when a window painted it, on a virtual rig in real time.

    The fastest status message gives the offset of the engine's clock, so an age is too long by
    at most the latency of that message.
    """
    import pyqtgraph as pg
    from PySide6.QtCore import QTimer
    from PySide6.QtTest import QTest

    from gui.shell.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice

    pg.mkQApp()
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = folder
        window = MainWindow(choice=ThemeChoice.LIGHT)
        window.resize(*SIZE)
        window.show()
        ages = _SampleAges(window)
        window.live_page.timer.timeout.connect(lambda: QTimer.singleShot(0, ages.on_paint))
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
        newest_s = self._plots.data.timeline.newest_s
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


class RedrawCosts(NamedTuple):
    """Wall time of each redraw in ms: live, and while scrolling back through ten minutes."""

    live: list[float]
    back: list[float]


def redraw_costs_ms(frames: int = FRAMES) -> RedrawCosts:
    """Return the time of redraws, which read new samples, prepare and paint them."""
    import pyqtgraph as pg

    from gui.live.live_plots import LivePlots
    from gui.widgets.theme import ThemeChoice, apply_theme
    from tests.gui.fake_engine import FakeEngine

    pg.mkQApp()
    with tempfile.TemporaryDirectory() as folder:
        engine = FakeEngine(Path(folder))
        scene = LivePlots(apply_theme(ThemeChoice.LIGHT))
        scene.resize(*SIZE)
        scene.show()
        for _ in range(MINUTES_BACK * 2):
            engine.write_samples(30_000, SPIKES_A_SAMPLE)
            scene.pull(engine.live)

        def draw_live() -> None:
            engine.write_samples(SAMPLES_A_FRAME, SPIKES_A_SAMPLE)
            with clock:
                scene.refresh(engine.live)
                pg.mkQApp().processEvents()

        def scroll_back() -> None:
            engine.write_samples(SAMPLES_A_FRAME, SPIKES_A_SAMPLE)
            with clock:
                scene.pull(engine.live)
                scene.navigation.scroll(-SCROLLED_SAMPLES)
                scene.draw()
                pg.mkQApp().processEvents()

        clock = _Clock()
        live = clock.costs_ms(draw_live, frames)
        back = clock.costs_ms(scroll_back, frames)
        scene.hide()
        engine.close()
    return RedrawCosts(live, back)


class _Clock:
    """Measures the time within ``with`` blocks."""

    def __init__(self) -> None:
        self._ms: list[float] = []
        self._began_s = 0.0

    def __enter__(self) -> None:
        self._began_s = time.perf_counter()

    def __exit__(self, *_: object) -> None:
        self._ms.append(1000 * (time.perf_counter() - self._began_s))

    def costs_ms(self, step: Callable[[], None], n: int) -> list[float]:
        """Return what ``n`` steps cost, behind a warm-up."""
        self._ms = []
        for _ in range(n + WARM_UP):
            step()
        return self._ms[WARM_UP:]
