"""Benchmark recording without a window: processor time of the engine, boards elsewhere."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rigctl.boards.drum_states import State
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE

SECONDS = 20.0
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``record.cpu_share`` and ``record.headroom``."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = str(Path(folder) / "runtime")
        share = recording_share(Path(folder))
        del os.environ[FOLDER_VARIABLE]
    note = (
        f"{SECONDS:.0f} s of the quick protocol in real time over TCP, 20 polls a second, live "
        "encoder, recorder; user and system time of the engine's process"
    )
    yield _row("record.cpu_share", round(share, 4), "of one core", note)
    yield _row("record.headroom", round(1.0 / share, 1), "× real time", note)


def _row(name: str, value: float, unit: str, note: str) -> dict[str, Any]:
    no_peer = {"peer": None, "peer_value": None, "ratio": None}
    return {"name": name, "value": value, "unit": unit, **no_peer, "note": note}


def recording_share(folder: Path) -> float:
    """Return the share of one core that an engine uses while it records from virtual boards."""
    with served_boards() as ports:
        rig = folder / "rig.toml"
        rig.write_text(f'[ports]\ndrum = "{ports["drum"]}"\ntaxels = "{ports["taxels"]}"\n')
        commission = ["setup", "--rig", str(rig), "--commission"]
        subprocess.run([sys.executable, "-m", "rigctl", *commission], check=True, stdout=sys.stderr)
        protocol = folder / "one-plate.toml"
        protocol.write_text(
            'name = "one-plate"\ntextures = ["A"]\nspeeds_mm_s = [40]\nforces_g = [500]\n'
            'repeats = 20\n[order]\nkind = "blocked"\n'
        )
        options = ["--protocol", str(protocol), "--out", str(folder / "session")]
        client = EngineClient.start(str(rig), run=options)
        try:
            _wait_for_recording(client)
            return _share_of(client.engine_file.pid)
        finally:
            client.request("abort", timeout_s=30)
            client.shut_down()


@contextmanager
def served_boards() -> Iterator[dict[str, str]]:
    """Yield the addresses of virtual boards that another process serves in real time."""
    command = [sys.executable, "-m", "rigctl", "serve", "--rig", "virtual", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        boards = json.loads(process.stdout.readline())
        try:
            yield {name: f"tcp://{boards[name]['tcp']}" for name in ("drum", "taxels")}
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()


def _wait_for_recording(client: EngineClient) -> None:
    """Answer the plate's prompt, which may be older than this client; return when the drum runs."""
    answered = None
    while True:
        for message in client.wait(60.0):
            if message.get("event") != "status":
                continue
            prompt = message["data"]["run"]["prompt"]
            if prompt is not None and prompt["id"] != answered:
                answered = prompt["id"]
                client.send("answer", prompt_id=answered, answer="ok")
            if message["data"]["state"] == State.RUN:
                return


def _share_of(pid: int) -> float:
    began, began_s = _processor_s(pid), time.perf_counter()
    time.sleep(SECONDS)
    return (_processor_s(pid) - began) / (time.perf_counter() - began_s)


def _processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_A_SECOND
