"""The force loop on its chip against the world's true force: nominal, and second variant.

Three things are told apart: the approach, while the drum is still, as the highest single
millisecond and as the highest mean of 200 ms; and the run, whose single milliseconds show the
ridges that pass below the sensor, and whose means show what the loop does about them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rigctl.simulation.bench.parameters import WorldParameters
from tests.benchmarks.firmware._firmware_rows import figure
from tests.benchmarks.firmware._force_map import (
    FORCES_G,
    SCENE,
    Cell,
    cell_of,
    cells_of,
    off,
    swing,
)
from tests.firmware.drum.support.other_drum import OtherDrum
from tests.firmware.drum.support.plant_drum import MEAN_MS

MEAN = f"{MEAN_MS} ms mean of the true force"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_*`` of the nominal plant, and ``variant_*``."""
    yield from nominal_rows(cells_of(WorldParameters(), "A"))
    yield from variant_rows()


def nominal_rows(cells: list[Cell]) -> Iterator[dict[str, Any]]:
    """The nominal plant over the whole grid."""
    scene = f"nominal plant, {SCENE}"
    still = f"{scene}, the drum still"
    settle_s = max(c.settle_s for c in cells)
    yield figure("force_settle_s", settle_s, "s", f"{MEAN} within ±2 %, from touch; {scene}")
    peak = max(c.approach_peak for c in cells)
    yield figure("force_overshoot", peak, "", f"highest millisecond; {still}")
    mean = max(c.approach_mean for c in cells)
    yield figure("force_overshoot_mean", mean, "", f"highest {MEAN}; {still}")
    yield figure("force_mean_error", off(cells), "", f"inside the sync window; {scene}")
    yield figure("force_swing", swing(cells), "", f"{MEAN} off the set, sync window; {scene}")
    ridges = max(c.motion_peak for c in cells)
    yield figure("force_motion_peak", ridges, "", f"highest millisecond, sync window; {scene}")


def variant_rows() -> Iterator[dict[str, Any]]:
    """The second variant, whose amplifier gives ten samples a second."""
    scenes = [(v, f) for f in FORCES_G for v in (40, 120)]
    with OtherDrum() as drum:
        drum.tune()
        cells = [cell_of(scene, drum.trial(*scene)) for scene in scenes]
    scene = f"HX711 at 10 samples a second, gains proposed by the drum, {len(cells)} trials"
    yield figure("variant_settle_s", max(c.settle_s for c in cells), "s", scene)
    yield figure("variant_overshoot", max(c.approach_peak for c in cells), "", scene)
    yield figure("variant_mean_error", off(cells), "", scene)
