"""Frozen values that modules exchange; every number has its unit.

Code never changes the arrays of a value after its construction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

ABOUT: Mapping[str, str] = {
    "operator": "who records",
    "sensor": "which sensor is mounted",
    "plate_lot": "the lot of the plates",
    "project": "what the session is for",
    "remarks": "what else a reader should know",
}
"""What people say of a session at its start, by the attribute that keeps it."""
OWN_NAME = r"\A\w[\w .,+()-]*\Z"
"""The name of a field that a lab keeps besides."""
PLATE_WIDTH_MM = 36.0
"""Of every texture plate, bent or flat."""
DRUM, TAXELS, FINGER = "drum", "taxels", "finger"
"""The boards, as they name themselves."""
SAMPLE_RATE_HZ = 1000
HELD_SAMPLES = 3
"""So many lost samples in a row are encoded as the one before them; after more it starts anew."""

DRAWN_WIRING = (0, 1, 2, 6, 7, 8, 12, 13, 14, 3, 4, 5, 9, 10, 11, 15, 16, 17)
"""The reading of each place of the paper's sensor, soldered as ``arduino/README.md`` draws it.

Places count row by row, the top layer first; a reading's number is 6 · line + input, and inputs
A0–A2 read the top layer, A3–A5 the bottom layer.
"""

SCALE_BAND_UG_PER_COUNT = (200, 25_000)
"""Smallest and largest magnitude of a load cell's scale; the nominal cell has 2,400.

An HX711 at gain 128 measures its bridge against the bridge's own supply: at a cell's capacity it
counts sensitivity · 256 · 2**23. A cell of 1 kg with 2 mV/V gives 233 µg a count, one of 50 kg
with 1 mV/V gives 23,283.

With a scale outside this band, a press of kilograms would read as grams or as nothing.
``rig.toml``, calibrations and the drum's wire refuse such a scale.
"""


class Verdict(StrEnum):
    """Outcome of one attempt at a trial."""

    COMMITTED = "committed"
    REJECTED = "rejected"
    ABORTED = "aborted"


@dataclass(frozen=True, slots=True)
class Gap:
    """Samples that the board took and that did not reach the host.

    ``first_counter`` is the unwrapped board counter of the first lost sample.
    """

    first_counter: int
    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class Block:
    """Taxel samples in the order in which they were taken, from one decoding step.

    ``counters``: int64 (n,), the board's own sample number, unwrapped since its boot.
    ``samples``: uint16 (n, n_taxels), 0–1023.
    ``flags``: uint8 (n,), bits of :class:`rigctl.boards.taxel_frames.Flag`.
    ``edges``: uint8 (n,), sync rises mod 4 in bits 0–1, index marks mod 4 in bits 2–3.
    ``gaps``: losses found directly before or inside this block.
    ``arrived_s``: loop time at which the bytes arrived.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    flags: NDArray[np.uint8]
    edges: NDArray[np.uint8]
    gaps: tuple[Gap, ...]
    arrived_s: float

    def __len__(self) -> int:
        return int(self.counters.shape[0])


@dataclass(frozen=True, slots=True)
class Spikes:
    """Spike trains as compressed sparse rows.

    Train ``i`` is ``sample_index[row_start[i]:row_start[i + 1]]``: ascending 0-based indices of
    the samples in which v crossed threshold, one entry per spike.
    Rows are SA taxel 1 … n, then RA taxel 1 … n.
    """

    row_start: NDArray[np.int64]
    sample_index: NDArray[np.int32]
    n_samples: int

    @classmethod
    def from_trains(cls, trains: Sequence[NDArray[np.int32]], n_samples: int) -> Spikes:
        """Return spikes from the sample indices of each train, int32, one train or more."""
        starts = np.zeros(len(trains) + 1, np.int64)
        np.cumsum([len(train) for train in trains], out=starts[1:])
        return cls(starts, np.concatenate(trains), n_samples)

    def train(self, row: int) -> NDArray[np.int32]:
        """Return the sample indices of one train, int32."""
        return self.sample_index[self.row_start[row] : self.row_start[row + 1]]

    @property
    def n_trains(self) -> int:
        """Number of rows."""
        return int(self.row_start.shape[0]) - 1


class Position(NamedTuple):
    """One measurement of a tracker, in the tracker's own frame.

    ``at_s``: the loop time at which it holds, which is its arrival less the source's known latency.
    ``valid``: False where the tracker says that it has lost its reference.
    """

    at_s: float
    x_mm: float
    y_mm: float
    z_mm: float
    valid: bool


class LoadcellSample(NamedTuple):
    """One conversion of the load-cell amplifier."""

    sequence: int
    board_time_us: int
    raw_counts: int
    force_g: float


@dataclass(frozen=True, slots=True)
class DrumState:
    """One poll of the drum in engineering units, with the loop time of the reply.

    ``values`` holds every register of the poll block by name, scaled; ``loadcell`` the new
    samples since the previous poll, oldest first; ``loadcell_lost`` counts those that are
    missing. ``board_time_us`` and the sequence numbers are unwrapped.
    """

    at_s: float
    board_time_us: int
    state: int
    fault: int
    fault_bits: int
    steps: int
    angle_deg: float
    speed_mm_s: float
    force_g: float
    actuator_position_um: int
    actuator_drive_permille: int
    sync_count: int
    sync_rise_us: int
    sync_fall_us: int
    index_count: int
    status_bits: int
    loadcell: tuple[LoadcellSample, ...]
    loadcell_lost: int
    values: dict[str, float]


@dataclass(frozen=True, slots=True)
class BoardIdentity:
    """The identity that a board reports.

    ``boot_count`` changes when it reboots, and is 0 of a board that keeps no count.
    """

    board: str
    firmware_version: str
    build_hash: str
    wire_version: int
    boot_count: int
    reset_cause: int
    details: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PluginUse:
    """What a session keeps of another package's part in it; ``height_mm``: of an axis."""

    kind: str
    name: str
    package: str
    version: str
    height_mm: float | None = None

    def __str__(self) -> str:
        return f"{self.kind} {self.name} of {self.package} {self.version}"


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One trial of a plan. ``trial_id`` counts from 1 in planned order and never changes.

    In force mode ``position`` the drum presses to ``depth_mm`` below contact and ``force_g`` is 0.
    ``mount`` counts the mountings of the texture's plate, from 1.
    """

    trial_id: int
    texture: str
    speed_mm_s: float
    force_g: float
    repeat: int
    travel_mm: float
    force_mode: str = "hold"
    direction: str = "forward"
    depth_mm: float = 0.0
    # Without it the digest of a plan that mounts each plate once is that of earlier versions.
    mount: int = field(default=1, repr=False)

    @property
    def duration_s(self) -> float:
        """Nominal length of the recorded window."""
        return self.travel_mm / self.speed_mm_s

    @property
    def n_samples(self) -> int:
        """Samples of the trial, counted from the rise of the sync line."""
        return round(self.duration_s * SAMPLE_RATE_HZ)


@dataclass(frozen=True, slots=True)
class TrialRow:
    """One finished attempt at a trial, as stored.

    ``first_counter`` is the board counter of the first sample at or after the rise of sync,
    ``first_sample`` its row in the part's ``/taxels`` data; -1 where sync did not rise.
    """

    trial: PlannedTrial
    attempt: int
    part: int
    first_counter: int
    first_sample: int
    count: int
    verdict: Verdict
    reasons: tuple[str, ...]
    started_s: float
    ended_s: float
    mean_speed_mm_s: float
    mean_force_g: float


class TrialMark(NamedTuple):
    """A note at a moment of a trial: seconds since its first sample, 0 for all of it."""

    at_s: float
    text: str


@dataclass(frozen=True, slots=True)
class Event:
    """A timed event, for people and for programs.

    ``kind`` is a short lower-case word (``state``, ``fault``, ``trial``, ``prompt``, ``gap``,
    ``log``, …); ``text`` one sentence; ``data`` JSON-able details.
    """

    at_s: float
    kind: str
    text: str
    data: dict[str, Any] = field(default_factory=dict)


COMPLETE, INCOMPLETE, RECORDING, UNREADABLE = "complete", "incomplete", "recording", "unreadable"


@dataclass(frozen=True, slots=True)
class SessionLine:
    """What a list of sessions says of one.

    ``state``: one of the four above; ``reason`` says why, empty for a complete one.
    ``start_utc``, ``modified_utc`` (of the newest part): ISO 8601. ``marked_bad``:
    attempts that a person marked bad.
    """

    path: str
    state: str
    reason: str = ""
    start_utc: str = ""
    modified_utc: str = ""
    experiment: str = ""
    protocol: str = ""
    operator: str = ""
    sensor: str = ""
    plate_lot: str = ""
    project: str = ""
    rig: str = ""
    simulated: bool = False
    trials_planned: int = 0
    trials_committed: int = 0
    marked_bad: int = 0
    closing_digest: str = ""
    bytes: int = 0
