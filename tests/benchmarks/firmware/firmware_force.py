"""Measure the force loop on its chip: true contact force, nominal plant and second variant.

The approach, while the drum is still, gives the highest single millisecond and the highest mean of
200 ms. The run gives the same: its single milliseconds show the ridges that pass below the sensor,
its means the response of the loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rigctl.bench.parameters import WorldParameters
from tests.benchmarks.firmware._firmware_rows import figure
from tests.benchmarks.firmware._force_map import (
    FORCES_G,
    SCENE,
    Cell,
    largest_mean_error,
    largest_swing,
    make_cell,
    measure_cells,
)
from tests.firmware.drum.support.other_drum import OtherDrum
from tests.firmware.drum.support.plant_drum import MEAN_MS

MEAN = f"{MEAN_MS} ms mean of the true force"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_*`` of the nominal plant, and ``variant_*``."""
    yield from nominal_rows(measure_cells(WorldParameters(), "A"))
    yield from variant_rows()


def nominal_rows(cells: list[Cell]) -> Iterator[dict[str, Any]]:
    """Yield the figures of the nominal plant over the whole grid."""
    scene = f"nominal plant, {SCENE}"
    still = f"{scene}, the drum still"
    settle_s = max(c.settle_s for c in cells)
    yield figure("force_settle_s", settle_s, "s", f"{MEAN} within ±2 %, from touch; {scene}")
    peak = max(c.approach_peak for c in cells)
    yield figure("force_overshoot", peak, "", f"highest millisecond; {still}")
    mean = max(c.approach_mean for c in cells)
    yield figure("force_overshoot_mean", mean, "", f"highest {MEAN}; {still}")
    yield figure(
        "force_mean_error", largest_mean_error(cells), "", f"inside the sync window; {scene}"
    )
    yield figure(
        "force_swing", largest_swing(cells), "", f"{MEAN} off the set, sync window; {scene}"
    )
    ridges = max(c.motion_peak for c in cells)
    yield figure("force_motion_peak", ridges, "", f"highest millisecond, sync window; {scene}")


def variant_rows() -> Iterator[dict[str, Any]]:
    """Yield the figures of the second variant, whose amplifier gives ten samples a second."""
    scenes = [(v, f) for f in FORCES_G for v in (40, 120)]
    with OtherDrum() as drum:
        drum.tune()
        cells = [make_cell(scene, drum.trial(*scene)) for scene in scenes]
    scene = f"HX711 at 10 samples a second, gains proposed by the drum, {len(cells)} trials"
    yield figure("variant_settle_s", max(c.settle_s for c in cells), "s", scene)
    yield figure("variant_overshoot", max(c.approach_peak for c in cells), "", scene)
    yield figure("variant_mean_error", largest_mean_error(cells), "", scene)
