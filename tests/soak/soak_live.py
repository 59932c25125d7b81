"""An hour of simulated streaming: the window shows and the recorder writes, and nothing grows.

``make soak`` runs it; the name of the file keeps it out of the suite. The encoder, the live file,
the recorder and the window are the real ones, in one process; only the boards are left out, so that
an hour passes in minutes.
"""

from __future__ import annotations

import gc
import os
import time
from pathlib import Path

os.environ["QT_QPA_PLATFORM"] = "offscreen"

import numpy as np
import pytest
from PySide6.QtWidgets import QApplication

from rigctl.boards.taxel_frames import Flag
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.pipeline import SamplePipeline
from rigctl.session.recorder import Recorder
from rigctl.values import Block
from tests.gui.fake_engine import FakeEngine
from tests.gui.steps import SharedWindow, wait_until
from tests.session.building import recorder

MINUTES = 60
STEP = 100
"""Samples between two redraws: ten a second of simulated time."""
STEPS_A_MINUTE = 60_000 // STEP
TRIAL_STEPS, PERIOD_STEPS = 40, 60
"""A trial lasts four seconds of every six."""
WARM_UP_MIN = 12
"""Then the eleven minutes of scroll-back are full."""
MOST_GROWTH_MIB = 20.0
MOST_SLOWER = 1.5
"""The last ten minutes may cost so many times the first ten; other people use the machine."""
PLATES = "ABC"


def memory_mib() -> float:
    """Return the resident memory of this process."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Streaming:
    """A rig that is recorded and shown, one step at a time; costs in ms of each step."""

    def __init__(self, shared: SharedWindow, engine: FakeEngine, session: Path) -> None:
        self.window, self.engine = shared.window, engine
        self.recorder: Recorder = recorder(session)
        self.recorder.begin_part("start", "A")
        low, high = engine.live.normalisation
        encoder = Encoder(Normalisation(low, high, "soak"))
        self._pipeline = SamplePipeline(encoder, engine.writer, waits_for_disk=True)
        self._pipeline.set_recorder(self.recorder)
        self._random = np.random.default_rng(1)
        self._steps = 0
        self.redraw_ms: list[float] = []
        self.latency_ms: list[float] = []

    def step(self) -> None:
        """Let samples arrive and the window show them."""
        block = self._block()
        if self._steps % 10 == 0:
            self._send_status()
        began_s = time.perf_counter()
        self._pipeline.add_block(block)
        self.engine.write_drum(block.counters / 1000.0)
        used_s = time.process_time()
        self.window.live_page.refresh(self.engine.live)
        QApplication.processEvents()
        self.redraw_ms.append(1000 * (time.process_time() - used_s))
        self.latency_ms.append(1000 * (time.perf_counter() - began_s))
        self._steps += 1

    def _block(self) -> Block:
        counters = np.arange(self._steps * STEP, (self._steps + 1) * STEP, dtype=np.int64)
        wave = np.sin(2 * np.pi * counters[:, None] / 1000 * np.linspace(4, 21, 18) / 3)
        samples = 500 + 180 * wave + 12 * self._random.standard_normal((STEP, 18))
        is_high = self._steps % PERIOD_STEPS < TRIAL_STEPS
        rises = (self._steps // PERIOD_STEPS + 1) % 4
        return Block(
            counters,
            samples.astype(np.uint16),
            np.full(STEP, Flag.SYNC if is_high else 0, np.uint8),
            np.full(STEP, rises, np.uint8),
            (),
            float(counters[-1]) / 1000,
        )

    def _send_status(self) -> None:
        number = self._steps // PERIOD_STEPS
        plate = PLATES[number % len(PLATES)]
        current = {"texture": plate, "speed_mm_s": 80.0, "force_g": 500.0}
        run = {"state": "running", "trial_id": number, "current": current}
        self.engine.send_status(run=run)
        if self._steps % PERIOD_STEPS == 0:
            self.engine.send_event("trial", f"trial {number} committed", self._steps / 10)
        self.window.poll()


def _shown(name: str, ms: list[float], steps: int) -> tuple[float, float]:
    """Print a cost of the first and of the last ten minutes, and return their medians."""
    parts = {"first": ms[:steps], "last": ms[-steps:]}
    for part, values in parts.items():
        p50, p99 = np.percentile(values, [50, 99])
        print(f"{name}, {part} ten minutes: median {p50:.2f} ms, p99 {p99:.2f} ms")
    first, last = (float(np.median(values)) for values in parts.values())
    return first, last


def test_an_hour_of_streaming_grows_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RIGCTL_RUNTIME", str(tmp_path))
    QApplication.instance() or QApplication([])
    shared, engine = SharedWindow(), FakeEngine(tmp_path)
    shared.engine = engine
    shared.window.resize(1400, 900)
    shared.window.show()
    shared.window.connect_rig("virtual")
    wait_until(lambda: shared.window.engine_link.live is not None)
    shared.window.live_page.toggle_alignment()
    rig = Streaming(shared, engine, tmp_path / "session")
    mib: dict[int, float] = {}
    for minute in range(1, MINUTES + 1):
        for _ in range(STEPS_A_MINUTE):
            rig.step()
        if minute in (5, WARM_UP_MIN, MINUTES):
            mib[minute] = memory_mib()
            print(f"minute {minute}: {mib[minute]:.0f} MiB")
    rig.recorder.close()
    shared.window.engine_link.close()
    shared.window.engine_link.wait_closed()
    shared.window.close()
    redraw = _shown("redraw, processor time", rig.redraw_ms, 10 * STEPS_A_MINUTE)
    latency = _shown("sample to pixel behind the boards", rig.latency_ms, 10 * STEPS_A_MINUTE)
    assert rig.recorder.status.failure is None
    assert mib[MINUTES] - mib[WARM_UP_MIN] <= MOST_GROWTH_MIB
    assert redraw[1] <= MOST_SLOWER * redraw[0]
    assert latency[1] <= MOST_SLOWER * latency[0]
