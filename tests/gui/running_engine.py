"""A real engine with a protocol that runs for long, started by another client than the window."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rigctl.acquisition.rpc.client import EngineClient

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
    while engine.request("status")["run"]["state"] != "running":
        pass
    return engine


def wait_ended(engine: EngineClient) -> dict[str, Any]:
    """Wait for the end of the run; return its last status."""
    while (run := engine.request("status")["run"])["state"] not in ("done", "aborted", "failed"):
        pass
    return dict(run)
