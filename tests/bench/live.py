"""What a redraw of the whole live scene costs, data preparation included, without a display."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

SIZE = (1400, 900)
SAMPLES_A_FRAME = 33
FRAMES = 600
WARM_UP = 40
SPIKES_A_SAMPLE = 0.08
NOTE = (
    "offscreen raster engine, 1400x900, one CPU core: force, speed, 18 traces, 36-row raster "
    "of 10 s at 80 spikes/s a row, heat map, rates; pull, preparation and painting"
)


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``live.redraw_ms_p50`` and ``live.redraw_ms_p99``."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    costs_ms = redraw_costs_ms()
    for name, quantile in (("p50", 50), ("p99", 99)):
        yield {
            "name": f"live.redraw_ms_{name}",
            "value": round(float(np.percentile(costs_ms, quantile)), 2),
            "unit": "ms",
            "peer": None,
            "peer_value": None,
            "ratio": None,
            "note": NOTE,
        }


def redraw_costs_ms(frames: int = FRAMES) -> list[float]:
    """Wall time of each redraw: pull what is new, prepare it, paint it."""
    import pyqtgraph as pg

    from gui import theme
    from gui.scene import Scene
    from tests.gui.fake_engine import FakeEngine

    app = pg.mkQApp()
    theme.apply(app, theme.LIGHT)
    with tempfile.TemporaryDirectory() as folder:
        engine = FakeEngine(Path(folder))
        engine.produce(11_000, SPIKES_A_SAMPLE)
        scene = Scene(theme.LIGHT)
        scene.resize(*SIZE)
        scene.show()
        costs_ms = []
        for _ in range(frames + WARM_UP):
            engine.produce(SAMPLES_A_FRAME, SPIKES_A_SAMPLE)
            began_s = time.perf_counter()
            scene.refresh(engine.live)
            app.processEvents()
            costs_ms.append(1000 * (time.perf_counter() - began_s))
        scene.hide()
        engine.close()
    return costs_ms[WARM_UP:]
