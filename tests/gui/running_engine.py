"""A real engine with a protocol that runs for long, started by another client than the window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl.engine.rpc.client import EngineClient
from tests.waiting import until

LONG = """
name = "long"
textures = ["A"]
speeds_mm_s = [40]
forces_g = [500]
repeats = 500
"""


def start_protocol(folder: Path) -> EngineClient:
    """Start another engine, and return its client once its protocol runs."""
    protocol = folder / "long.toml"
    protocol.write_text(LONG)
    words = ["--protocol", str(protocol), "--out", str(folder / "session"), "--yes"]
    engine = EngineClient.start("virtual", paced=True, run=words)
    until(lambda: engine.request("status")["run"]["state"] == "running")
    return engine


def wait_ended(engine: EngineClient) -> dict[str, Any]:
    """Wait for the end of the run; return its last status."""
    until(lambda: engine.request("status")["run"]["state"] in ("done", "aborted", "failed"))
    return dict(engine.request("status")["run"])
