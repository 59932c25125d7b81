"""Benchmark the live plots beside plain pyqtgraph, and the age of a sample on the screen."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.recording._plain_plots import plain_costs_ms
from tests.benchmarks.recording._sample_ages import STATIONS, measured_shares_ms

SIZE = (1400, 900)
SAMPLES_A_FRAME = 33
FRAMES = 600
LIMITED = ("live.redraw_ms_p50", "live.redraw_ms_p99", "live.scroll_back_ms_p99")
"""Figures in processor time, which other programs do not change much."""
MINUTES_BACK = 11
SCROLLED_SAMPLES = 1000
"""A frame: 600 of them go back through ten minutes."""
WARM_UP = 40
SPIKES_A_SAMPLE = 0.08
SECONDS = 20.0
REDRAW_NOTE = (
    "offscreen raster engine, 1400x900, one CPU core: force, speed, 18 traces, 36-row raster "
    "of 10 s at 80 spikes/s a row, heat map, rates; pull, preparation and painting; processor time"
)
BACK_NOTE = (
    "the same views and samples that go on to arrive, while 600 frames scroll back by 1 s each"
)
ZOOM_NOTE = "the same views paused, each frame of another span, 10 s to 6 minutes, drawn anew"
STATION_NOTE = "one station of the way; the cable delivers every 20 ms, as an adapter does"
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
    yield _row("live.zoom_ms_p99", ours.zoomed, 99, ZOOM_NOTE, None, 16.0)
    shares = measured_shares_ms(SIZE, SECONDS)
    yield _row("live.sample_to_pixel_ms_p99", shares.sum(axis=1), 99, _age_note(shares), None, 36.0)
    for station, share in zip(STATIONS, shares.T, strict=True):
        yield _row(f"live.sample_to_pixel_{station}_ms_p99", share, 99, STATION_NOTE, None, None)


def _age_note(shares: NDArray[np.float64]) -> str:
    """Return what the age of a sample is, with the median share of each station and the load."""
    medians = np.median(shares, axis=0)
    stations = zip(STATIONS, medians, strict=True)
    words = ", ".join(f"{station} {ms:.1f} ms" for station, ms in stations)
    load = "" if not hasattr(os, "getloadavg") else f"; load {os.getloadavg()[0]:.1f}"
    return f"{AGE_NOTE}; medians: {words}{load} on {os.cpu_count()} CPUs"


def _row(
    name: str,
    ms: list[float] | NDArray[np.float64],
    percent: int,
    note: str,
    plain: list[float] | None,
    target: float | None,
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
        "limit": target if name in LIMITED else None,
        "note": note if target is None else f"target {target:g} ms; {note}",
    }


class RedrawCosts(NamedTuple):
    """Processor time of each redraw in ms: live, scrolling back through ten minutes, zooming."""

    live: list[float]
    back: list[float]
    zoomed: list[float]


def redraw_costs_ms(frames: int = FRAMES) -> RedrawCosts:
    """Return the time of redraws, which read new samples, prepare and paint them."""
    import pyqtgraph as pg

    from gui.live.live_plots import LivePlots
    from gui.widgets.theme import ThemeChoice, apply_palette
    from tests.gui.fake_engine import FakeEngine

    pg.mkQApp()
    with tempfile.TemporaryDirectory() as folder:
        engine = FakeEngine(Path(folder))
        scene = LivePlots(apply_palette(ThemeChoice.LIGHT))
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

        def zoom() -> None:
            engine.write_samples(SAMPLES_A_FRAME, SPIKES_A_SAMPLE)
            with clock:
                scene.pull(engine.live)
                scene.navigation.zoom(next(factors))
                pg.mkQApp().processEvents()

        clock, factors = _Clock(), cycle([*[1.25] * 16, *[0.8] * 16])
        live = clock.costs_ms(draw_live, frames)
        back = clock.costs_ms(scroll_back, frames)
        zoomed = clock.costs_ms(zoom, frames)
        scene.hide()
        engine.close()
    return RedrawCosts(live, back, zoomed)


class _Clock:
    """Measures the processor time within ``with`` blocks."""

    def __init__(self) -> None:
        self._ms: list[float] = []
        self._began_s = 0.0

    def __enter__(self) -> None:
        self._began_s = time.process_time()

    def __exit__(self, *_: object) -> None:
        self._ms.append(1000 * (time.process_time() - self._began_s))

    def costs_ms(self, step: Callable[[], None], n: int) -> list[float]:
        """Return what ``n`` steps cost, behind a warm-up."""
        self._ms = []
        for _ in range(n + WARM_UP):
            step()
        return self._ms[WARM_UP:]
