"""Engines without a rig: they record requests, send scripted messages and write live data."""

from __future__ import annotations

import os
from copy import deepcopy
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.drum_states import State
from rigctl.boards.taxel_frames import Flag
from rigctl.engine.live_file import LiveReader, LiveWriter
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.errors import RigctlError

STATUS: dict[str, Any] = {
    "at_s": 1.0,
    "rig": "virtual",
    "simulated": True,
    "texture": "A",
    "drum_connected": True,
    "taxels_connected": True,
    "state": int(State.IDLE),
    "state_words": "off",
    "fault": 0,
    "fault_words": "",
    "force_g": 0.4,
    "force_set_g": 500.0,
    "speed_mm_s": 0.0,
    "speed_set_mm_s": 80.0,
    "steps": 0,
    "angle_deg": 12.5,
    "actuator_position_um": 8000,
    "tared": True,
    "homed": False,
    "is_moved_by_hand": False,
    "frame_rate_hz": 1000.0,
    "lost_samples": 0,
    "gaps": 0,
    "last_block_age_s": 0.012,
    "poll_age_s": 0.02,
    "poll_retries": 0,
    "loadcell_lost": 0,
    "clock_ppm": {"drum": 1187.0, "taxels": -904.0},
    "boards": {
        "drum": {
            "firmware": "0.1",
            "boot_count": 4,
            "reset": "power-up",
            "unwanted": False,
            "late_ticks": 0,
            "longest_isr_us": 25,
            "free_stack_bytes": 5386,
            "stack_free_percent": 66,
            "idle_percent": 68.3,
        },
        "taxels": {
            "firmware": "1.1",
            "boot_count": 7,
            "reset": "its reset pin",
            "unwanted": False,
            "supply_v": 5.01,
            "self_test": [],
            "late_ticks": 0,
            "longest_isr_us": 22.56,
            "free_stack_bytes": 1344,
            "stack_free_percent": 66,
            "idle_percent": 52.5,
        },
    },
    "recording": {
        "active": False,
        "samples_on_disk": 0,
        "samples_last_s": 0,
        "folder": None,
        "disk_free_bytes": 210_000_000_000,
        "hours_left": None,
        "failure": None,
    },
    "run": {
        "state": "idle",
        "text": "",
        "reasons": [],
        "trial_id": None,
        "trials_planned": 0,
        "trials_committed": 0,
        "trials_rejected": 0,
        "eta_s": None,
        "elapsed_s": 0.0,
        "current": None,
        "prompt": None,
        "session": None,
    },
}


ALONE = {"clients": [{"id": 1, "name": "this window"}], "holder": 1, "asking": []}
"""One client, which has control."""


class LiveFile(Protocol):
    """A writer or a reader of live data."""

    def close(self) -> None:
        """Close the file."""


class FakeClient:
    """A replacement for EngineClient. A subclass adds live data."""

    shares_memory = True
    is_behind = False

    def __init__(self, live_path: Path, status: dict[str, Any], *live: LiveFile) -> None:
        self.engine_file = EngineFile("fake", 1, 9, "", "virtual", str(live_path))
        self.process = None
        self.requests: list[tuple[str, dict[str, Any]]] = []
        self.status = deepcopy(status)
        self.refusals: dict[str, str] = {}
        self.replies = True
        self.failure: RigctlError | None = None
        self.is_closed = self.is_left = False
        self._number = 0
        self.welcome: dict[str, dict[str, Any]] = {
            "introduce": {"client": 1, "control": ALONE},
            "history": {"events": []},
        }
        """Results of what a window asks when it joins; these requests are not recorded."""
        self._messages: list[dict[str, Any]] = []
        self._live_files = live
        self._ends: tuple[int, ...] = ()

    @property
    def commands(self) -> list[str]:
        """Return the commands of all requests."""
        return [command for command, _ in self.requests]

    def fileno(self) -> int:
        """Return a descriptor that is never readable: the test decides when messages arrive."""
        self._ends = os.pipe()
        return self._ends[0]

    def send(self, command: str, **args: Any) -> int:
        """Record a request, and reply to it unless ``replies`` is False."""
        self._number += 1
        number = self._number
        if command in self.welcome:
            result = self.welcome[command]
            self._messages.append({"reply": number, "ok": True, "result": result})
            return number
        self.requests.append((command, args))
        if self.replies:
            self._messages.append(self._reply(number, command))
        return number

    def drain(self) -> list[dict[str, Any]]:
        """Return the messages since the last call."""
        messages, self._messages = self._messages, []
        if self.failure is not None and not messages:
            raise self.failure
        return messages

    def close(self) -> None:
        """Close the live buffer."""
        if not self.is_closed:
            self.is_closed = True
            for file in self._live_files:
                file.close()
            for end in self._ends:
                os.close(end)

    def leave(self, timeout_s: float = 30.0) -> int | None:
        """Close, as the engine would decide whether to end."""
        self.is_left = True
        self.close()
        return 0

    def send_status(self, **changes: Any) -> None:
        """Send the status after changing some fields; ``run`` and ``recording`` merge."""
        for name, value in changes.items():
            if isinstance(value, dict) and name in ("run", "recording"):
                self.status[name].update(value)
            else:
                self.status[name] = value
        data = deepcopy(self.status)
        self._messages.append({"event": "status", "at_s": 1.0, "text": "", "data": data})

    def send_event(self, kind: str, text: str, event_s: float = 1.0, **data: Any) -> None:
        """Send an event."""
        self._messages.append({"event": kind, "at_s": event_s, "text": text, "data": data})

    def refuse_all(self, sentence: str) -> None:
        """Refuse every request so far, as if none had a reply."""
        for number in range(1, self._number + 1):
            self._refuse(number, sentence)

    def answer_all(self) -> None:
        """Reply to every request so far, as if none had a reply."""
        for number in range(1, self._number + 1):
            self._messages.append({"reply": number, "ok": True, "result": {}})

    def _refuse(self, number: int, sentence: str) -> None:
        reply = {"reply": number, "ok": False, "error": sentence, "exit_code": 3}
        self._messages.append(reply)

    def _reply(self, number: int, command: str) -> dict[str, Any]:
        if command in self.refusals:
            sentence = self.refusals[command]
            return {"reply": number, "ok": False, "error": sentence, "exit_code": 3}
        return {"reply": number, "ok": True, "result": {}}


class FakeEngine(FakeClient):
    """An engine of the drum rig."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self._random = np.random.default_rng(seed)
        self._counter = 0
        self._writer = LiveWriter(folder / "live", 18)
        self._writer.set_range(np.full(18, 200, np.uint16), np.full(18, 800, np.uint16))
        self.live = LiveReader(folder / "live")
        super().__init__(folder / "live", STATUS, self.live, self._writer)

    def write_samples(
        self,
        n: int,
        dense: float = 0.05,
        skip: int = 0,
        sync: bool = False,
        force_g: float = 500.0,
    ) -> None:
        """Write ``n`` taxel samples and those of the load cell; ``skip`` lost samples precede.

        ``sync``: the level of the sync line, which is high during a trial.
        """
        self._counter += skip
        time_s = np.arange(self._counter, self._counter + n) / 1000.0
        wave = np.sin(2 * np.pi * time_s[:, None] * np.linspace(4, 21, 18) / 3)
        noise = self._random.standard_normal((n, 18))
        self.write_readings((500 + 180 * wave + 12 * noise).astype(np.uint16), dense, sync, force_g)

    def write_readings(
        self,
        samples: NDArray[np.uint16],
        dense: float = 0.05,
        sync: bool = False,
        force_g: float = 500.0,
    ) -> None:
        """Write these readings, (n, 18), with spikes at random."""
        n = len(samples)
        counters = np.arange(self._counter, self._counter + n, dtype=np.int64)
        time_s = counters / 1000.0
        rate = dense * (1 + np.sin(2 * np.pi * 0.7 * time_s))[:, None]
        spikes = (self._random.random((n, 36)) < rate).astype(np.uint8)
        self._writer.add_taxels(
            time_s=time_s,
            counters=counters,
            samples=samples,
            flags=np.full(n, Flag.SYNC if sync else 0, np.uint8),
            spikes=spikes,
        )
        self.write_drum(time_s, force_g)
        self._counter += n

    @property
    def writer(self) -> LiveWriter:
        """The live data, for a test that writes samples itself."""
        return self._writer

    def write_drum(self, time_s: NDArray[np.float64], force_g: float = 500.0) -> None:
        """Write the load cell's samples of a time, one for twelve of the taxels."""
        drum_s = time_s[::12]
        force = force_g + 4 * self._random.standard_normal(len(drum_s))
        self._writer.add_drum(
            drum_s,
            force_g=force,
            force_set_g=500.0,
            speed_mm_s=80.0,
            speed_set_mm_s=80.0,
            state=int(State.RUN),
        )
