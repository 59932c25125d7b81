"""The status that the engine of the moving finger sends to its clients, ten times a second.

The messages are those of :mod:`rigctl.engine.rpc.messages`; the events ``batch``
and ``prediction`` follow a scan as it happens.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from rigctl.engine.rpc.messages import BoardStatus, LslScope, RecordingStatus, SittingStatus
from rigctl.finger.plan import ScanQuality

NOMINAL_QUALITY = ScanQuality()


@dataclass(frozen=True, slots=True)
class CurrentScan:
    """The trial that is to be made: which plate, how fast, which attempt.

    ``trial_id``: its number in the planned order, from 1, which every table and text names it by.
    """

    stage: str = ""
    texture: str = "?"
    profile: str = ""
    repeat: int = 0
    attempt: int = 0
    scanning: bool = False
    trial_id: int = 0


@dataclass(frozen=True, slots=True)
class FingerRunStatus(SittingStatus):
    """Progress of the protocol of the moving finger.

    ``correct`` of ``classified`` scans were named correctly. ``confusion``: the number of scans by
    true and predicted texture. ``coverage``: share of the sets that hold the true texture.
    ``quality``: the limits of the protocol.
    """

    scan: CurrentScan | None = None
    textures: tuple[str, ...] = ()
    classified: int = 0
    correct: int = 0
    confusion: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    coverage: float = 0.95
    quality: ScanQuality = NOMINAL_QUALITY


@dataclass(frozen=True, slots=True)
class FingerEngineStatus:
    """State of board, tracker, recording and run.

    Ages are loop time since the newest data, or the last loss, None before any. Positions are
    plate coordinates. ``late_velocities``: velocities that reached the board after their batch.
    ``latency_p99_ms``: 99th percentile of each kind of :mod:`rigctl.finger.devices` that
    was measured. ``lsl``: who can see what is streamed over the Lab Streaming Layer.
    """

    at_s: float = 0.0
    rig: str = ""
    simulated: bool = False
    finger_connected: bool = False
    tracker_connected: bool = False
    tracker: str = ""
    sample_rate_hz: float = 0.0
    lost_samples: int = 0
    lost_age_s: float | None = None
    damaged_frames: int = 0
    block_age_s: float | None = None
    position_age_s: float | None = None
    position_valid: bool = False
    along_mm: float = 0.0
    across_mm: float = 0.0
    height_mm: float = 0.0
    velocity_mm_s: float = 0.0
    in_contact: bool = False
    late_velocities: int = 0
    dropouts: int = 0
    outliers: int = 0
    latency_p99_ms: Mapping[str, float] = field(default_factory=dict)
    board: BoardStatus = field(default_factory=BoardStatus)
    recording: RecordingStatus = field(default_factory=RecordingStatus)
    run: FingerRunStatus = field(default_factory=FingerRunStatus)
    lsl: LslScope = LslScope.OFF


def parse_finger_status(data: Mapping[str, Any]) -> FingerEngineStatus:
    """Return the status in a message's ``data``; missing fields get their defaults.

    Raises ValueError with the field whose value is of another type.
    """
    return msgspec.convert(data, FingerEngineStatus)
