"""Benchmark a client through the socket beside one that shares the engine's memory.

Both are clients of the same engine in real time, in turns; ``make bench`` fails above a limit.
"""

from __future__ import annotations

import math
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.acquisition.live_buffer import DRUM_LIVE, LiveReader
from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.runtime_folder import FOLDER_VARIABLE
from rigctl.acquisition.sharing.remote_client import RemoteClient
from tests.benchmarks.recording.realtime import figure

TURNS = 6
TURN_S = 5.0
LOOK_S = 0.004
WARM_UP_S = 3.0
PEER = "a client that shares the engine's memory, in turns in the same run"
NOTE = (
    f"virtual rig in real time, {TURNS} turns of {TURN_S:g} s each with one client and the other; "
    "loopback, a look every 4 ms"
)


@dataclass
class Costs:
    """What one kind of client saw and cost: ages in s, bytes, and seconds of both clocks."""

    ages_s: list[float] = field(default_factory=list)
    received_bytes: int = 0
    wall_s: float = 0.0
    engine_s: float = 0.0

    def age_ms_p99(self) -> float:
        """Return the 99th percentile of the age of a sample at the client."""
        return 1000 * float(np.percentile(self.ages_s, 99))

    def bytes_per_s(self) -> float:
        """Return what came through the socket."""
        return self.received_bytes / self.wall_s

    def cpu_share(self) -> float:
        """Return the engine's processor time over the time on the wall."""
        return self.engine_s / self.wall_s


def measure() -> Iterator[dict[str, Any]]:
    """Yield age, bytes and processor share of both kinds of clients."""
    far, near = measured_costs()
    loads = f"{NOTE}; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} CPUs"
    rows = (
        ("sample_to_client_ms_p99", far.age_ms_p99(), near.age_ms_p99(), "ms", 200.0),
        ("bytes_per_s", far.bytes_per_s(), near.bytes_per_s(), "B/s", 300_000.0),
        ("cpu_share", far.cpu_share(), near.cpu_share(), "of one core", 0.25),
    )
    for name, value, peer, unit, limit in rows:
        yield figure(f"remote.{name}", value, unit, limit, loads, PEER, peer)


def measured_costs() -> tuple[Costs, Costs]:
    """Return the costs of a client through the socket, and of one with the shared memory."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ[FOLDER_VARIABLE] = folder
        holder = EngineClient.start("virtual", paced=True)
        offset_s = _clock_offset_s(holder)
        far, near = Costs(), Costs()
        for _ in range(TURNS):
            for costs, is_far in ((far, True), (near, False)):
                _take_turn(costs, holder, offset_s, is_far=is_far)
                holder.drain()
        holder.shut_down()
    return far, near


def _clock_offset_s(client: EngineClient) -> float:
    """Return what to add to the engine's time: the fastest of its statuses in the first seconds."""
    end_s, offset_s = time.monotonic() + WARM_UP_S, math.inf
    while time.monotonic() < end_s:
        for message in client.wait(0.5):
            if message.get("event") == "status":
                offset_s = min(offset_s, time.monotonic() - float(message["at_s"]))
    return offset_s


def _take_turn(costs: Costs, holder: EngineClient, offset_s: float, *, is_far: bool) -> None:
    engine = holder.engine_file
    elsewhere = replace(engine, live="")
    client = RemoteClient(elsewhere, DRUM_LIVE) if is_far else EngineClient(engine)
    with closing(client), closing(LiveReader(Path(client.engine_file.live))) as live:
        _watch(client, live, 1.0, Costs(), offset_s)
        began_s, used_s = time.monotonic(), _processor_s(engine.pid)
        received = client.received_bytes
        _watch(client, live, TURN_S, costs, offset_s)
        costs.wall_s += time.monotonic() - began_s
        costs.engine_s += _processor_s(engine.pid) - used_s
        costs.received_bytes += client.received_bytes - received


def _watch(
    client: EngineClient, live: LiveReader, seconds: float, costs: Costs, offset_s: float
) -> None:
    """Look for new samples as a window does, and note how old each of them is then."""
    end_s, seen = time.monotonic() + seconds, live.taxel_head
    while (now_s := time.monotonic()) < end_s:
        client.drain()
        if (head := live.taxel_head) != seen:
            new = live.taxels(head - seen)
            costs.ages_s += (time.monotonic() - offset_s - new.time_s).tolist()
            seen = head
        time.sleep(max(0.0, LOOK_S - (time.monotonic() - now_s)))


def _processor_s(pid: int) -> float:
    """Return the processor time of a process, all threads, in s."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
