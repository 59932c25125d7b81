"""Protocols for real engines, and one that runs for long, started by another client."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rigctl.engine.rpc.client import EngineClient
from tests.waiting import until


def ridges(name: str, repeats: int, *, texture: str = "D", speed_mm_s: float = 120) -> str:
    """Return a protocol of one plate, pressed with 500 g."""
    keys = {"name": name, "textures": [texture], "speeds_mm_s": [speed_mm_s], "forces_g": [500]}
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    return "\n".join([*lines, f"repeats = {repeats}", ""])


LONG = ridges("long", 500, texture="A", speed_mm_s=40)


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
