"""Benchmark recording without a window: processor time of the engine, boards elsewhere."""

from __future__ import annotations

import asyncio
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
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.encoder.encoder import Encoder
from rigctl.encoder.normalisation import Normalisation
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.pipeline import SamplePipeline
from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import FOLDER_VARIABLE
from rigctl.rig import open_rig
from rigctl.values import SAMPLE_RATE_HZ
from tests.session.building import recorder

SECONDS = 20.0
STREAM_S = 120.0
DELIVERY_BYTES = 660
"""20 ms of frames, as a virtual port delivers them."""
TICKS_A_SECOND = os.sysconf("SC_CLK_TCK")


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``record.cpu_share`` and ``record.headroom``."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = str(Path(folder) / "runtime")
        share = recording_share(Path(folder))
        del os.environ[FOLDER_VARIABLE]
        times_real = headroom(Path(folder))
    note = (
        f"{SECONDS:.0f} s of the quick protocol in real time over TCP, 20 polls a second, live "
        "encoder, recorder; user and system time of the engine's process"
    )
    yield _row("record.cpu_share", round(share, 4), "of one core", note)
    note = (
        f"{STREAM_S:.0f} s of the virtual board's frames, 20 ms at a time, through decoder, live "
        "encoder, live file and recorder with its digests, until they are on disk; none lost"
    )
    yield _row("record.headroom", round(times_real, 1), "× real time", note)


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


def headroom(folder: Path) -> float:
    """Return how many times faster than real time a stream of frames is recorded."""
    stream = frames_of_board()
    live = LiveWriter(folder / "live.ring", 18)
    pipeline = SamplePipeline(Encoder(Normalisation.full_scale(18)), live, waits_for_disk=True)
    decoder = FrameDecoder(18)
    with recorder(folder / "stream") as session:
        session.begin_part("start", "A")
        pipeline.set_recorder(session)
        began_s = time.perf_counter()
        for start in range(0, len(stream), DELIVERY_BYTES):
            delivery = stream[start : start + DELIVERY_BYTES]
            for block in decoder.feed(delivery, start / len(stream) * STREAM_S).blocks:
                pipeline.add_block(block)
        pipeline.set_recorder(None)
        session.wait_written()
        took_s = time.perf_counter() - began_s
        assert session.status.samples_on_disk == pipeline.sample_count
    live.close()
    assert pipeline.lost_samples == 0
    return pipeline.sample_count / SAMPLE_RATE_HZ / took_s


def frames_of_board() -> bytes:
    """Return what a virtual taxel board sends in :data:`STREAM_S`."""
    rig, deliveries = open_rig("virtual", paced=False), list[bytes]()
    try:
        rig.taxels.link.open(lambda data, _: deliveries.append(data), sys.exit)
        rig.loop.run_until_complete(asyncio.sleep(STREAM_S))
    finally:
        rig.close()
    return b"".join(deliveries)


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
