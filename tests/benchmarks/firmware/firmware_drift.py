"""Measure the drift of the force over a hundred trials, on the chip, for every plant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters
from tests.benchmarks.firmware._firmware_rows import PREDECESSOR, figure
from tests.benchmarks.firmware._force_map import (
    DRIFT_SCENE,
    DRIFT_TRIALS,
    MEAN_ERROR,
    for_each_plant,
    mean_errors,
)

DRIFT = 0.005
"""Limit of the change between the first ten trials and the last ten."""
SPEED_MM_S, FORCE_G = DRIFT_SCENE
SCENE = f"{DRIFT_TRIALS} trials at {FORCE_G} g, {SPEED_MM_S} mm/s"
Tens = dict[str, NDArray[np.float64]]


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_drift*`` and ``force_lasting_error``."""
    found = for_each_plant(mean_errors, "force_drift", (WorldParameters(), "A"))
    tens = {name: errors.reshape(-1, 10).mean(axis=1) for name, errors in found}
    yield from drift_rows(tens)


def drift_rows(tens: Tens) -> Iterator[dict[str, Any]]:
    """Yield the figures of the mean errors of each ten trials of each plant; "" is nominal."""
    drifts = {name: abs((1 + of[-1]) / (1 + of[0]) - 1) for name, of in tens.items()}
    lasting = {name: float(np.abs(of).max()) for name, of in tens.items()}
    yield figure("force_drift", drifts.pop(""), "", f"nominal plant, {SCENE}", PREDECESSOR, 0.034)
    scene = f"each of {len(drifts)} plants, {SCENE}"
    yield figure(
        "force_drift_worst", max(drifts.values()), "", f"{scene}; {list_missed(drifts, DRIFT)}"
    )
    missed = list_missed(lasting, MEAN_ERROR)
    what = f"farthest mean of ten trials; nominal plant and {scene}; {missed}"
    yield figure("force_lasting_error", max(lasting.values()), "", what)


def list_missed(shares: dict[str, float], limit: float) -> str:
    """Return the plants that miss the limit, with their values."""
    missed = {name: share for name, share in shares.items() if share >= limit}
    plants = "; ".join(f"{name or 'nominal'} {share:.2%}" for name, share in sorted(missed.items()))
    return f"not kept by {plants}" if plants else "all kept"
