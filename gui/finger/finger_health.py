"""The health strip of the finger: the figures that show whether scans can count."""

from __future__ import annotations

from gui.live.health_cell import (
    RECENT_LOSS_S,
    CellSpec,
    HealthRow,
    Reading,
    age_reading,
    disk_reading,
    judge,
    loss_line,
    loss_reading,
)
from gui.widgets.status_lamp import Level
from rigctl.realtime.latency import FEATURES, SCREEN
from rigctl.realtime.messages import FingerEngineStatus
from rigctl.values import SAMPLE_RATE_HZ

RATE_TOLERANCE = 0.02
AGE_LIMIT_S = 0.3
TRACKER_AGE_LIMIT_S = 0.1
"""A scan with a longer time without a position does not count."""
LATENCY_LIMITS_MS = {FEATURES: 5.0, SCREEN: 50.0}
CELLS = {
    "rate": CellSpec("Sample rate", 126, "Samples of the last second: 1000 Hz ± 2 %"),
    "lost": CellSpec(
        "Lost samples",
        110,
        "Samples that the board took and the computer never received since the engine started: "
        f"BAD for {RECENT_LOSS_S:g} s after each loss",
    ),
    "block": CellSpec("Block age", 118, "Time since the last samples arrived: at most 300 ms"),
    "tracker": CellSpec(
        "Tracker age", 128, "Time since the last position of the tracker: at most 100 ms, and valid"
    ),
    "dropouts": CellSpec("Dropouts", 118, "Gaps in the tracker's positions that were bridged"),
    "outliers": CellSpec("Outliers", 114, "Positions that no finger can reach, left out"),
    "late": CellSpec(
        "Late velocities", 128, "Velocities that reached the board after their batch: 0"
    ),
    FEATURES: CellSpec(
        "Features", 116, "From sending a velocity to its features, 99th percentile: at most 5 ms"
    ),
    SCREEN: CellSpec(
        "On screen",
        120,
        "From sending a velocity to the painted answer, 99th percentile: at most 50 ms",
    ),
    "disk": CellSpec(
        "Disk left", 130, "Free disk space, and how long it lasts at the present recording rate"
    ),
}


class FingerHealthStrip(HealthRow):
    """One cell per figure."""

    def __init__(self) -> None:
        super().__init__(CELLS)

    def show_status(self, status: FingerEngineStatus) -> None:
        """Show and judge the figures of a status."""
        self.show_readings(finger_readings(status))
        line = loss_line("samples", status.lost_samples, status.lost_age_s)
        self.cells["lost"].setToolTip(f"{CELLS['lost'].tooltip}\n{line}")


def finger_readings(status: FingerEngineStatus) -> dict[str, Reading]:
    """Return the reading of each cell."""
    connected = status.finger_connected
    latencies = {
        kind: _latency(kind, status.latency_p99_ms.get(kind)) for kind in LATENCY_LIMITS_MS
    }
    return {
        "rate": _rate(status),
        "lost": loss_reading(status.lost_samples, status.lost_age_s, connected),
        "block": age_reading(status.block_age_s, AGE_LIMIT_S, connected),
        "tracker": _tracker(status),
        "dropouts": _noted(status.dropouts, status.tracker_connected),
        "outliers": _noted(status.outliers, status.tracker_connected),
        "late": _noted(status.late_velocities, connected),
        **latencies,
        "disk": disk_reading(status.recording),
    }


def _rate(status: FingerEngineStatus) -> Reading:
    error = abs(status.sample_rate_hz - SAMPLE_RATE_HZ) / SAMPLE_RATE_HZ
    level = judge(status.finger_connected and error <= RATE_TOLERANCE)
    return Reading(f"{status.sample_rate_hz:.0f} Hz", level)


def _tracker(status: FingerEngineStatus) -> Reading:
    connected, age_s = status.tracker_connected, status.position_age_s
    if connected and age_s is not None and not status.position_valid:
        return Reading("lost", Level.BAD)
    return age_reading(age_s, TRACKER_AGE_LIMIT_S, connected)


def _noted(count: int, connected: bool) -> Reading:
    """Return a number that is bridged or repeated: worth a look, no data are lost."""
    level = (Level.WARN if count else Level.OK) if connected else Level.OFF
    return Reading(f"{count}", level)


def _latency(kind: str, ms: float | None) -> Reading:
    if ms is None:
        return Reading("–", Level.OFF)
    return Reading(f"{ms:.1f} ms", judge(ms <= LATENCY_LIMITS_MS[kind]))
