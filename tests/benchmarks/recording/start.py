"""Benchmark the start: help, import and first demo of an installed wheel, and the window."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from tests.installed import build_wheel, install

ROUNDS = 5
MOST_HELPS, MOST_WINDOWS = 1.0, 3.0
"""Limits in units of the peer's time in the same run, so that they hold on any processor."""
HELP = """
import sys
from runpy import run_module
sys.argv = [sys.argv[1], "--help"]
try:
    run_module(sys.argv[0], run_name="__main__")
except SystemExit:
    pass
"""
WINDOW = """
from gui.app import check_display, paused_collector
with paused_collector():
    check_display()
    import pyqtgraph as pg
    from gui.shell.main_window import MainWindow
    from gui.widgets.theme import ThemeChoice
    app = pg.mkQApp()
    window = MainWindow(choice=ThemeChoice.LIGHT)
    window.show()
app.processEvents()
"""
LIVE = """
import time
from PySide6.QtCore import QTimer
import gui.app
shown = gui.app._shown_window
def look(window):
    if window.live_plots.data.history.head:
        print("\\n%.3f" % time.time(), flush=True)
        window.attach.leave()
    else:
        QTimer.singleShot(2, lambda: look(window))
def shown_and_watched(*how):
    window = shown(*how)
    QTimer.singleShot(0, lambda: look(window))
    return window
gui.app._shown_window = shown_and_watched
raise SystemExit(gui.app.main(["--rig", "virtual"]))
"""
EXAMPLES = """
import pyqtgraph as pg
app = pg.mkQApp()
from pyqtgraph.examples.ExampleApp import ExampleLoader
window = ExampleLoader()
window.show()
app.processEvents()
"""
COUNT = """
import os, sys
print("\\n%.3f" % sum(os.times()[:4]))
sys.stdout.flush()
os._exit(0)
"""
HELP_NOTE = "rigctl --help and pip --help in turns, median of 5; user and system time"
WINDOW_NOTE = (
    "from the start of Python until the window has handled its first events, offscreen; "
    "in turns, median of 5; user and system time"
)
LIVE_NOTE = (
    "from the start of Python until the window of `rigctl gui --rig virtual` has the first samples "
    "of the engine that it has started; wall time, median of 5; target 2.5 s"
)
FIRST = {
    "import": (["python", "-c", "import rigctl"], 0.1),
    "help": (["rigctl", "--help"], 0.3),
    "demo": (["rigctl", "demo", "--no-window"], 40.0),
}
"""What a stranger begins with, and how long each may take, in s."""
FIRST_NOTE = "the first one of a newly installed wheel, in an empty home; user and system time"


def measure() -> Iterator[dict[str, Any]]:
    """Yield the rows ``start.*``."""
    yield from _measure_first()
    help_s, pip_s = _in_turns((HELP, "rigctl"), (HELP, "pip"))
    yield _row("start.help_s", help_s, "pip --help", pip_s, MOST_HELPS, HELP_NOTE)
    window_s, examples_s = _in_turns((WINDOW, ""), (EXAMPLES, ""))
    peer = "pyqtgraph's example browser"
    yield _row("start.window_s", window_s, peer, examples_s, MOST_WINDOWS, WINDOW_NOTE)
    live_s = round(median([_until_live_s() for _ in range(ROUNDS + 1)][1:]), 3)
    yield {"name": "start.live_s", "value": live_s, "unit": "s", "note": LIVE_NOTE}


def _measure_first() -> Iterator[dict[str, Any]]:
    """Yield ``start.first_*_s``, with empty caches."""
    with TemporaryDirectory() as folder:
        installed = install(build_wheel(Path(folder)), Path(folder))
        for name, (words, most_s) in FIRST.items():
            before = os.times()
            ran = installed.run(*words)
            now = os.times()
            assert ran.returncode == 0, ran
            used_s = now.children_user + now.children_system - sum(before[2:4])
            by_wall = f"; {now.elapsed - before.elapsed:.1f} s by the wall"
            row = {"name": f"start.first_{name}_s", "value": round(used_s, 3), "unit": "s"}
            yield row | {"limit": most_s, "note": FIRST_NOTE + by_wall}


def _in_turns(*programs: tuple[str, str]) -> list[float]:
    """Return the median processor time of each program in s; the first round warms the disk."""
    rounds = [[_seconds(source, word) for source, word in programs] for _ in range(ROUNDS + 1)]
    return [median(times_s) for times_s in zip(*rounds[1:], strict=True)]


def _seconds(source: str, word: str) -> float:
    return _last_number(source + COUNT, word)


def _until_live_s() -> float:
    began_s = time.time()
    return _last_number(LIVE, "") - began_s


def _last_number(source: str, word: str) -> float:
    done = subprocess.run(
        [sys.executable, "-c", source, word],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
    )
    return float(done.stdout.split()[-1])


def _row(
    name: str, value_s: float, peer: str, peer_s: float, most: float, note: str
) -> dict[str, Any]:
    return {
        "name": name,
        "value": round(value_s, 3),
        "unit": "s",
        "peer": peer,
        "peer_value": round(peer_s, 3),
        "ratio": round(value_s / peer_s, 2),
        "limit": round(most * peer_s, 3),
        "note": note,
    }
