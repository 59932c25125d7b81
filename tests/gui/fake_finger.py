"""An engine of the moving finger without a rig."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rigctl.finger.board_messages import SampleFlag
from rigctl.finger.decoder import FingerBlock
from rigctl.finger.live_file import FingerLiveWriter
from rigctl.finger.trackers.plate_frame import PlatePosition
from tests.gui.fake_engine import FakeClient

TEXTURES = ("A", "B", "D", "L", "N")
STATUS: dict[str, Any] = {
    "at_s": 1.0,
    "rig": "simulated finger, virtual board, seed 0, session 1",
    "simulated": True,
    "finger_connected": True,
    "tracker_connected": True,
    "tracker": "simulated tracker",
    "sample_rate_hz": 1000.0,
    "lost_samples": 0,
    "block_age_s": 0.012,
    "position_age_s": 0.004,
    "position_valid": True,
    "along_mm": 120.0,
    "across_mm": -3.0,
    "in_contact": True,
    "late_velocities": 0,
    "dropouts": 0,
    "outliers": 0,
    "latency_p99_ms": {},
    "recording": {
        "active": True,
        "samples_on_disk": 12000,
        "samples_last_s": 1000,
        "folder": "/s",
        "disk_free_bytes": 210_000_000_000,
    },
    "run": {"state": "idle", "textures": list(TEXTURES)},
}
RUNNING: dict[str, Any] = {
    "state": "running",
    "trials_planned": 25,
    "trials_committed": 11,
    "eta_s": 70.0,
    "scan": {
        "stage": "run",
        "texture": "B",
        "profile": "slow",
        "repeat": 1,
        "attempt": 1,
        "scanning": False,
        "trial_id": 12,
    },
}


class FakeFinger(FakeClient):
    """An engine of the moving finger; ``scan`` numbers the scan that its events are of."""

    def __init__(self, folder: Path) -> None:
        self.scan = 1
        self._counter = 0
        self._writer = FingerLiveWriter(folder / "finger-live")
        self._writer.set_range(np.full(9, 20, np.uint16), np.full(9, 220, np.uint16))
        super().__init__(folder / "finger-live", STATUS, self._writer)

    def send_instruction(
        self, texture: str, profile: str, trial_id: int = 1, attempt: int = 1
    ) -> None:
        """Ask the operator for a slide."""
        text = f"plate {texture}, {profile}: slide over the plate"
        about = {"trial_id": trial_id, "attempt": attempt}
        self.send_event("instruction", text, texture=texture, profile=profile, **about)

    def send_batch(self, number: int, velocity_mm_s: float, distance_mm: float) -> None:
        """Send that the batch ``number``, from 1, is scaled."""
        self.send_event(
            "batch",
            f"{velocity_mm_s:.0f} mm/s",
            scan=self.scan,
            velocity_mm_s=velocity_mm_s,
            distance_mm=distance_mm,
            seconds=number / 10 + 0.02,
            scaled_s=number / 10,
        )

    def send_prediction(self, texture: str, share: float, **changes: Any) -> None:
        """Send an answer with this probability; the rest is spread over the other textures."""
        rest = (1 - share) / (len(TEXTURES) - 1)
        data: dict[str, Any] = {
            "scan": self.scan,
            "at_s": 2.0,
            "windows": 7,
            "distance_mm": 70.0,
            "seconds": 0.9,
            "texture": texture,
            "probabilities": {name: share if name == texture else rest for name in TEXTURES},
            "texture_set": [texture],
            "known": True,
            "decided": False,
            "is_final": False,
            "sent_s": 1.9,
        }
        self.send_event("prediction", texture, **{**data, **changes})

    def write_samples(self, spikes: np.ndarray, *, in_scan: bool, first: bool = False) -> None:
        """Write samples with spikes, uint8 (n, 9); the first of them may be a scan's first."""
        n = len(spikes)
        counters = np.arange(self._counter, self._counter + n, dtype=np.int64)
        flags = np.full(n, SampleFlag.IN_SCAN if in_scan else 0, np.uint8)
        if first:
            flags[0] |= SampleFlag.FIRST
        readings = np.full((n, 9), 100, np.uint16)
        block = FingerBlock(counters, flags, readings, spikes.astype(np.uint8), 0)
        self._writer.add_block(block, (self._counter + n) / 1000)
        self._counter += n

    def write_position(self, at_s: float, along_mm: float, *, valid: bool = True) -> None:
        """Write a position of the tracker."""
        self._writer.add_position(PlatePosition(at_s, along_mm, 1.0, 0.0, valid))
