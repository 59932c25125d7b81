"""How far the force wanders over a hundred trials, on the chip, on every plant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.parameters import WorldParameters
from tests.benchmarks.firmware._firmware_rows import PREDECESSOR, figure
from tests.benchmarks.firmware._force_map import (
    DRIFT_SCENE,
    DRIFT_TRIALS,
    MEAN_ERROR,
    mean_errors,
    over_plants,
)

DRIFT = 0.005
"""What is asked for: between the first ten trials and the last ten."""
SPEED_MM_S, FORCE_G = DRIFT_SCENE
SCENE = f"{DRIFT_TRIALS} trials at {FORCE_G} g, {SPEED_MM_S} mm/s"
Tens = dict[str, NDArray[np.float64]]


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_drift*`` and ``force_lasting_error``."""
    found = over_plants(mean_errors, "force_drift", (WorldParameters(), "A"))
    tens = {name: errors.reshape(-1, 10).mean(axis=1) for name, errors in found}
    yield from drift_rows(tens)


def drift_rows(tens: Tens) -> Iterator[dict[str, Any]]:
    """From the mean errors of each ten trials, shares, of each plant; the nominal one is ``""``."""
    drifts = {name: abs((1 + of[-1]) / (1 + of[0]) - 1) for name, of in tens.items()}
    lasting = {name: float(np.abs(of).max()) for name, of in tens.items()}
    yield figure("force_drift", drifts.pop(""), "", f"nominal plant, {SCENE}", PREDECESSOR, 0.034)
    scene = f"each of {len(drifts)} plants, {SCENE}"
    yield figure("force_drift_worst", max(drifts.values()), "", f"{scene}; {above(drifts, DRIFT)}")
    what = f"farthest mean of ten trials; nominal plant and {scene}; {above(lasting, MEAN_ERROR)}"
    yield figure("force_lasting_error", max(lasting.values()), "", what)


def above(shares: dict[str, float], limit: float) -> str:
    """Which plants miss the limit, and by how much."""
    missed = {name: share for name, share in shares.items() if share >= limit}
    told = "; ".join(f"{name or 'nominal'} {share:.2%}" for name, share in sorted(missed.items()))
    return f"not kept by {told}" if told else "all kept"
