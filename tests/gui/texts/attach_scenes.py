"""The window beside other clients: engines to join, another one in control, a run to leave."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from gui.shell.main_window import MainWindow
from rigctl.engine.rpc.client import FoundEngine
from rigctl.engine.rpc.engine_files import EngineFile
from tests.gui.fake_engine import FakeEngine

OTHER = "window of annamaria.rothenberger on tactile-lab-pc-02 (process 1234567)"
CLIENTS = [{"id": 1, "name": "this window"}, {"id": 2, "name": OTHER}]
RIG = "/home/annamaria.rothenberger/rigs/second-drum-with-new-load-cell.toml"


def attach_scenes(window: MainWindow, engine: FakeEngine, run: dict[str, Any]) -> Iterator[str]:
    """Show each strip, and yield the name of the scene; ``engine`` is connected."""
    files = [EngineFile(f"e{n}", 123_456 + n, 9, "", RIG, "") for n in range(4)]
    found = [FoundEngine(file, run, OTHER) for file in files]
    attach = window.attach
    window.drum.alarms.strip.dismiss.click()  # of the scene before
    attach.engines.show_engines("An engine of the virtual rig runs already.", found, may_start=True)
    yield "Running engines"
    attach.engines.closed.emit()
    engine.send_event("control", "", clients=CLIENTS, holder=2, asking=[1])
    window.poll()
    yield "Another window has control"
    engine.send_event("control", "", clients=CLIENTS, holder=1, asking=[2])
    window.poll()
    yield "Another window asks for control"
    engine.send_event("control", "", clients=CLIENTS, holder=1, asking=[])
    window.poll()
    attach.closing.ask(str(run["session"]))
    yield "Closing in a run"
    attach.closing.hide()
