"""Check that the load cell's forces are its counts with one scale, one that a cell can have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigctl.session.read.part import StructuredArray
from rigctl.session.verify.values.rules import describe_wrong
from rigctl.session.verify.values.tables import HIGHEST_COUNT
from rigctl.values import SCALE_BAND_UG_PER_COUNT

Floats = NDArray[np.float64]

MIN_STEP_COUNTS = 100
MIN_STEPS = 20
"""Steps of the force that a scale is found from."""
TOLERANCE_G = 2.0
"""Far above what a tare that depends on the drum's angle changes between two conversions."""
UG_PER_G = 1e6
CHANGED_SHARE = 0.01
"""A larger share of forces that do not fit means another scale, set in the middle of a part."""


def check_scale(rows: StructuredArray) -> Iterator[str]:
    """Check the forces of one part against its counts; ``rows``: /loadcell, in order."""
    raw, force_g = rows["raw_counts"].astype(np.float64), rows["force_g"].astype(np.float64)
    scale_g = _scale(raw, force_g) if np.isfinite(force_g).all() else None
    if scale_g is None:
        return
    low, high = SCALE_BAND_UG_PER_COUNT
    if not low * 0.99 <= abs(scale_g) * UG_PER_G <= high * 1.01:
        yield (
            f"the forces of /loadcell are {abs(scale_g) * UG_PER_G:.4g} µg a count, a load cell "
            f"has {low} to {high}"
        )
        return
    odd = _lone(force_g - scale_g * raw)
    if 0 < len(odd) <= max(1, CHANGED_SHARE * len(rows)):
        yield describe_wrong(
            "force_g of /loadcell", odd, rows["force_g"], "its raw_counts give another force"
        )


def note_saturation(rows: StructuredArray) -> Iterator[str]:
    """Note conversions at the end of the converter's range: a fault of the rig, not of the file."""
    at_end = np.count_nonzero(np.abs(rows["raw_counts"].astype(np.int64)) >= HIGHEST_COUNT - 1)
    if at_end:
        yield f"the load cell was at the end of its range in {at_end} conversions"


def _scale(raw: Floats, force_g: Floats) -> float | None:
    """Return the median of force over counts in steps, g a count; None without enough steps."""
    steps, steps_g = np.diff(raw), np.diff(force_g)
    large = np.abs(steps) >= MIN_STEP_COUNTS
    if np.count_nonzero(large) < MIN_STEPS:
        return None
    return float(np.median(steps_g[large] / steps[large]))


def _lone(tare_g: Floats) -> NDArray[np.int64]:
    """Return single rows whose tare is neither that of the row before nor that of the next."""
    before, after = np.abs(np.diff(tare_g))[:-1], np.abs(np.diff(tare_g))[1:]
    across = np.abs(tare_g[2:] - tare_g[:-2])
    lone: NDArray[np.int64] = (
        np.flatnonzero((before > TOLERANCE_G) & (after > TOLERANCE_G) & (across < TOLERANCE_G / 2))
        + 1
    )
    return lone
