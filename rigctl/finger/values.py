"""Frozen values of the moving finger's recordings; every number has its unit.

The named tuples have the columns of the session's table of the same name, in its order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.force_gain import ForceScaling
from rigctl.values import Gap, Verdict

MODEL_KIND = "model"
"""Kind of the event that says which representation's model names the scans of a run."""
PLATE_MM = 300.0
"""Length of a flat plate (Materials and Methods, Real-time Texture Classification)."""
MARKS_MM = (50.0, 250.0)
"""A trial begins and ends at these places: the middle 200 mm of the plate."""
PLATE_CORNERS_MM = {
    "start left": (0.0, 18.0),
    "start right": (0.0, -18.0),
    "end left": (300.0, 18.0),
    "end right": (300.0, -18.0),
}
"""Along and across the plate. Left and right as seen from its start towards its end."""
TEXTURES = ("A", "B", "D", "L", "N")
RUN_FIRST_SLIDE = 1 << 16
"""First slide of `run` in a simulated session: calibration has made the slides from 0 on."""


class VelocityProfile(StrEnum):
    """The velocity profiles of the paper's real-time experiment."""

    SLOW = "slow"
    MEDIUM = "medium"
    FAST = "fast"
    SLOW_TO_FAST = "slow-to-fast"
    FAST_TO_SLOW = "fast-to-slow"


class Stage(StrEnum):
    """The stages of the experiment, in their order (Protocol in Materials and Methods).

    NORMALISE finds the range of each taxel, TRAIN the classifier, CALIBRATE the mean features of
    a new session; RUN classifies in real time.
    """

    NORMALISE = "normalise"
    TRAIN = "train"
    CALIBRATE = "calibrate"
    RUN = "run"


class ScanKind(StrEnum):
    """The representations of a scan: the paper's two, and those with a gain for the force."""

    ORIGINAL = "Original"
    SPEED_SCALED = "Speed Scaled"
    DIVIDED = "Divided"
    SPEED_SCALED_DIVIDED = "Speed Scaled and Divided"
    CALIBRATED = "Calibrated"
    SPEED_SCALED_CALIBRATED = "Speed Scaled and Calibrated"

    @property
    def key(self) -> str:
        """The name in options and names of files."""
        return self.value.lower().replace(" ", "-")

    @property
    def is_speed_scaled(self) -> bool:
        """Whether its windows are of scaled time."""
        return self.value.startswith(ScanKind.SPEED_SCALED.value)

    @property
    def force_scaling(self) -> ForceScaling:
        """What scales its SA current for the force."""
        return _FORCE_SCALINGS.get(self, ForceScaling.NONE)


_FORCE_SCALINGS = {
    ScanKind.DIVIDED: ForceScaling.DIVIDED,
    ScanKind.SPEED_SCALED_DIVIDED: ForceScaling.DIVIDED,
    ScanKind.CALIBRATED: ForceScaling.CALIBRATED,
    ScanKind.SPEED_SCALED_CALIBRATED: ForceScaling.CALIBRATED,
}


@dataclass(frozen=True, slots=True)
class FingerTrial:
    """One scan of a plan. ``trial_id`` counts from 1 in planned order and never changes."""

    trial_id: int
    stage: Stage
    texture: str
    profile: VelocityProfile
    repeat: int


N_FINGER_TAXELS = 9


@dataclass(frozen=True, slots=True)
class FingerSamples:
    """Samples and spikes of the finger board in the order in which they were taken.

    ``counters``: int64 (n,), the board's own sample number, unwrapped since its boot.
    ``samples``: uint16 (n, 9), 0–1023. ``spikes``: uint8 (n, 9), as the board counted them.
    ``flags``: uint8 (n,), bits of :class:`rigctl.finger.board_messages.SampleFlag`.
    ``gaps``: losses found directly before or inside these samples.
    ``arrived_s``: loop time at which the bytes arrived.
    """

    counters: NDArray[np.int64]
    samples: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    flags: NDArray[np.uint8]
    gaps: tuple[Gap, ...]
    arrived_s: float

    def __len__(self) -> int:
        return int(self.counters.shape[0])


class TrackRow(NamedTuple):
    """One position of the finger, in the tracker's frame and in the plate's.

    ``at_s`` is the loop time at which it holds. Plate coordinates are NaN without a plate frame.
    ``valid`` is False where the tracker has lost its reference.
    """

    at_s: float
    x_mm: float
    y_mm: float
    z_mm: float
    along_mm: float
    across_mm: float
    height_mm: float
    valid: bool


class BatchRow(NamedTuple):
    """One batch of a scan: the velocity that the board used, and the estimate of the tracker.

    ``velocity_source`` is the board's :class:`rigctl.finger.board_messages.VelocitySource`,
    ``estimate_source`` the estimator's word (measured, interpolated, held). ``start_nm`` is the
    distance at the batch's first sample. ``estimate_mm_s`` and ``sent_s`` are NaN where no velocity
    was estimated or sent.
    """

    scan: int
    batch: int
    velocity_um_s: int
    velocity_source: int
    estimate_mm_s: float
    estimate_source: str
    dropouts: int
    outliers: int
    samples: int
    lost_samples: int
    start_nm: int
    sent_s: float
    reported_s: float


class WindowRow(NamedTuple):
    """One window of scaled time: spikes of the 9 taxels, and the real time that it took."""

    scan: int
    window: int
    real_ms: int
    spikes: tuple[int, ...]
    arrived_s: float


class PredictionRow(NamedTuple):
    """One answer of the classifier while a scan grows, or at its end.

    ``probabilities`` by texture; ``texture_set`` holds the true texture with the confidence that
    was asked for. ``known`` is False where the plate is none of the trained ones, ``decided`` is
    True from the answer that was sure enough, ``is_final`` at the end of the scan.
    """

    scan: int
    at_s: float
    windows: int
    distance_mm: float
    seconds: float
    texture: str
    probabilities: Mapping[str, float]
    texture_set: tuple[str, ...]
    known: bool
    decided: bool
    is_final: bool


class LatencyRow(NamedTuple):
    """Time from the arrival of a velocity to features, prediction or screen (``kind``)."""

    at_s: float
    scan: int
    kind: str
    ms: float


@dataclass(frozen=True, slots=True)
class FingerTrialRow:
    """One finished attempt at a trial of the moving finger, as stored.

    ``stage``, ``texture``, ``profile`` and ``repeat`` are those of the planned trial. ``scan`` is
    the board's number of the scan. ``first_counter`` is the board counter of the scan's first
    sample (``FIRST`` of the wire's flags), ``first_sample`` its row in the part's ``/taxels`` data;
    both are -1 without a scan. ``count`` samples reach to the scan's last one, lost ones included.

    ``mean_mm_s``, ``first_half_mm_s`` and ``second_half_mm_s`` are over the scan and its halves by
    distance. ``contact_share`` is the share of the scan in which the sensor touched the plate.
    ``predicted`` is empty and ``correct`` None for a trial that was not classified.
    """

    trial_id: int
    attempt: int
    part: int
    stage: str
    texture: str
    profile: str
    repeat: int
    scan: int
    first_counter: int
    first_sample: int
    count: int
    verdict: Verdict
    reasons: tuple[str, ...]
    started_s: float
    ended_s: float
    distance_mm: float
    mean_mm_s: float
    first_half_mm_s: float
    second_half_mm_s: float
    tracker_lost_s: float
    contact_share: float
    predicted: str = ""
    correct: bool | None = None
