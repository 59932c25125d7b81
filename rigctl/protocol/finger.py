"""The scans of the moving finger: plates, marks and velocity profiles."""

from __future__ import annotations

from enum import StrEnum

PLATE_MM = 300.0
"""Length of a flat plate (Materials and Methods, Real-time Texture Classification)."""
MARKS_MM = (50.0, 250.0)
"""A trial begins and ends at these places: the middle 200 mm of the plate."""
TEXTURES = ("A", "B", "D", "L", "N")


class VelocityProfile(StrEnum):
    """The velocity profiles of the paper's real-time experiment."""

    SLOW = "slow"
    MEDIUM = "medium"
    FAST = "fast"
    SLOW_TO_FAST = "slow-to-fast"
    FAST_TO_SLOW = "fast-to-slow"
