"""The scans of the moving finger: plates, marks and velocity profiles."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

PLATE_MM = 300.0
"""Length of a flat plate (Materials and Methods, Real-time Texture Classification)."""
MARKS_MM = (50.0, 250.0)
"""A trial begins and ends at these places: the middle 200 mm of the plate."""
PLATE_WIDTH_MM = 36.0
PLATE_CORNERS_MM = {
    "start left": (0.0, 18.0),
    "start right": (0.0, -18.0),
    "end left": (300.0, 18.0),
    "end right": (300.0, -18.0),
}
"""Along and across the plate. Left and right as seen from its start towards its end."""
TEXTURES = ("A", "B", "D", "L", "N")
PROTOCOL_KEYS = ("profiles", "stages", "reference_mm_s")
"""Keys that only a protocol of the moving finger has."""


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


@dataclass(frozen=True, slots=True)
class FingerTrial:
    """One scan of a plan. ``trial_id`` counts from 1 in planned order and never changes."""

    trial_id: int
    stage: Stage
    texture: str
    profile: VelocityProfile
    repeat: int
