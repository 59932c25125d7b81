"""Benchmark STOP: from the press of Esc or the button to the engine's log, in every scene."""

from __future__ import annotations

import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.cli import main
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE, running_engines, runtime_folder
from tests.benchmarks.recording.table import SET, ensure_set

SOURCE = "from tests.benchmarks.recording._stop_scenes import main; main()"
"""No module of its own, which the window's processes would load again."""
HOUR_MAP = """
time = { rate_hz = 1000 }
taxels = { columns = ["1..18"] }
labels = { texture = "felt", speed_mm_s = 40 }
"""
MOST_MS, MOST_TURN_MS = 100.0, 50.0
NOTE = (
    "virtual rig in real time in its engine's process, window 1400x900 offscreen; from the press "
    "to the event that another client of the engine has received; the longest of each scene: "
)
TURN_NOTE = "the longest turn of the window's thread in each scene, in its processor time: "
RESTYLE_NOTE = "the window's thread with another theme, which only a rig at rest allows"


def measure() -> Iterator[dict[str, Any]]:
    """Yield the longest way of STOP, and how long another theme keeps the window."""
    ensure_set()
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = folder
        answer, logged_s = _play(imported_hour(Path(folder)))
    shutil.rmtree(SET.with_name(f"{SET.name}-figures"))  # what the scenes have saved
    presses = answer["presses"]
    if len(logged_s) != len(presses):
        raise RuntimeError(f"{len(presses)} presses, but {len(logged_s)} stops in the engine's log")
    longest_ms: dict[str, float] = defaultdict(float)
    for (scene, pressed_s), at_s in zip(presses, logged_s, strict=True):
        longest_ms[scene] = max(longest_ms[scene], 1000 * (at_s - pressed_s))
    load = f"; load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    for name, scenes_ms, most_ms, note in (
        ("live.stop_ms_max", longest_ms, MOST_MS, NOTE),
        ("live.turn_ms_max", answer["turns_ms"], MOST_TURN_MS, TURN_NOTE),
    ):
        scenes = ", ".join(f"{scene} {ms:.0f}" for scene, ms in scenes_ms.items())
        yield _row(name, max(scenes_ms.values()), most_ms, note + scenes + load)
    yield _row("live.restyle_ms", answer["restyled_ms"], None, RESTYLE_NOTE + load)


def imported_hour(folder: Path) -> Path:
    """Import a trial of an hour into a folder; return its session."""
    noise = np.random.default_rng(0).integers(0, 1023, (60_000, 18)).astype(np.uint16)
    np.save(folder / "hour.npy", np.tile(noise, (60, 1)))
    (folder / "map.toml").write_text(HOUR_MAP)
    session = folder / "hour"
    arguments = ["--map", str(folder / "map.toml"), str(folder / "hour.npy"), "--out", str(session)]
    if main(["import", *arguments]):
        raise RuntimeError("the trial of an hour was not imported")
    return session


def _play(hour: Path) -> tuple[dict[str, Any], list[float]]:
    """Return what the window's process prints, and when the engine told of each STOP."""
    with subprocess.Popen(
        [sys.executable, "-c", SOURCE, str(SET.absolute()), str(hour)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
    ) as window:
        assert window.stdin is not None and window.stdout is not None
        window.stdout.readline()
        (engine,) = running_engines(runtime_folder())
        client = EngineClient(engine)
        try:
            window.stdin.write("go on\n")
            window.stdin.flush()
            logged_s = _stops(client, window.stdout.fileno())
            return json.loads(window.stdout.readline()), logged_s
        finally:
            client.close()


def _stops(client: EngineClient, until: int) -> list[float]:
    """Return when a STOP was told, until a descriptor can be read."""
    logged_s: list[float] = []
    while True:
        ready, _, _ = select.select([client.fileno(), until], [], [])
        now_s = time.monotonic()
        logged_s += [now_s for message in client.drain() if message.get("event") == "stop"]
        if until in ready:
            return logged_s


def _row(name: str, value: float, limit: float | None, note: str) -> dict[str, Any]:
    return {"name": name, "value": round(value, 1), "unit": "ms", "limit": limit, "note": note}
