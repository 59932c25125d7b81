"""Benchmark the trial table of 24,000 trials: until it is useful, and its longest turns.

``rigctl synth`` makes the set once in ``build/bench-table``: the paper's trials, 16 mm each, the
period of the widest ridges. A window of less has another mean force than asked, and such trials are
rejected.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

from tests.benchmarks.recording._reference_loop import STATED_MS, slowness

SET = Path("build/bench-table")
SOURCE = "from tests.benchmarks.recording._table_window import main; main()"
"""No module of its own, which the window's processes would load again."""
ROUNDS = 5
MOST_OPEN_S, MOST_FRAME_MS = 1.0, 16.7
"""Limits on a processor that takes 15 ms for the reference loop; on another one in proportion."""
OPEN_NOTE = (
    "24,000 trials in 16 parts, files in memory, window offscreen 1400x900; from the click on Open "
    "until the rows are painted"
)
STARTS = {
    "warm": "the reader is ready: it starts with the window",
    "cold": "the window has just been shown, the reader's process starts",
}
TURN_NOTE = "processor time of the Qt thread in a turn of its event loop, painting included"


def measure() -> Iterator[dict[str, Any]]:
    """Yield times until the table is useful, and the longest turns of the event loop."""
    ensure_set()
    _measure_once("cold")
    slow = [slowness()]
    found = [{start: _measure_once(start) for start in STARTS} for _ in range(ROUNDS)]
    slow.append(slowness())
    factor = max(slow)
    for start in STARTS:
        yield from _open_rows(start, [each[start] for each in found], factor)
    runs = [run for each in found for run in each.values()]
    longest_ms = max(run["longest_ms"] for run in runs)
    note = f"{TURN_NOTE}; cold, the window's own first painting is in it; {len(runs)} times"
    yield _row("table.open_longest_ms", longest_ms, "ms", None, note)
    for name in ("sort", "filter", "scroll"):
        ms = [turn for run in runs for turn in run[name]]
        note = f"{TURN_NOTE}; {len(ms)} turns, median {median(ms):.1f} ms"
        note += f"; the reference loop takes {factor * STATED_MS:.1f} ms"
        yield _row(f"table.{name}_longest_ms", max(ms), "ms", factor * MOST_FRAME_MS, note)


def ensure_set() -> None:
    """Make the set if it does not exist or has another protocol; it takes some minutes."""
    paper = Path("protocols/paper.toml").read_text(encoding="utf-8")
    text = paper.replace("travel_mm = 240", "travel_mm = 16")
    protocol = SET.with_suffix(".toml")
    is_same = protocol.exists() and protocol.read_text(encoding="utf-8") == text
    if is_same and (SET / "whole").exists():
        return
    if not is_same:
        shutil.rmtree(SET, ignore_errors=True)
        SET.parent.mkdir(exist_ok=True)
        protocol.write_text(text, encoding="utf-8")
    words = ("synth", "--plan", str(protocol), "--seed", "1", "--resume", "--out", str(SET))
    subprocess.run([sys.executable, "-m", "rigctl", *words], check=True)
    (SET / "whole").touch()


def _measure_once(start: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", SOURCE, str(SET.absolute()), start],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
    )
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _open_rows(start: str, runs: list[dict[str, Any]], factor: float) -> Iterator[dict[str, Any]]:
    """Yield the times of opening; their limits are those of the stated processor by ``factor``."""
    load = f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    for name, key, what in (
        ("open_s", "shown_s", f"{OPEN_NOTE}; {STARTS[start]}; median of {len(runs)}; {load}"),
        ("open_processor_s", "processor_s", "the same, processor time of all processes"),
        ("first_plots_s", "plotted_s", "the same, until the first trial is drawn"),
    ):
        limit = factor * MOST_OPEN_S if start == "warm" or key == "shown_s" else None
        yield _row(f"table.{start}.{name}", median(r[key] for r in runs), "s", limit, what)


def _row(name: str, value: float, unit: str, limit: float | None, note: str) -> dict[str, Any]:
    digits = 3 if unit == "s" else 1
    value, limit = round(value, digits), None if limit is None else round(limit, digits)
    return {"name": name, "value": value, "unit": unit, "limit": limit, "note": note}
