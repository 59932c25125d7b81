"""The force loop on its chip against the world's true force: nominal, over the ranges, drift."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.world.parameters import WorldParameters
from tests.bench._firmware_rows import PREDECESSOR, figure
from tests.firmware.plant_drum import MEAN_MS, PlantDrum, Trial

SPEEDS_MM_S = (40, 60, 80, 100, 120)
FORCES_G = (250, 500, 1000)
CORNERS = ((120, 250), (40, 1000))
TRIALS = 100
SETTLE_S, OVERSHOOT, MEAN_ERROR, OVER_APPROACH, DRIFT = 1.0, 0.05, 0.01, 0.10, 0.005
"""What is asked for."""
HARD = WorldParameters(
    actuator_lag_ms=50, dead_band=0.2, run_out_mm=0.1, backlash_mm=0.1, ripple_share=1.0
)
PLANTS: dict[str, tuple[WorldParameters, str]] = {
    "stiffness 900 g/mm": (WorldParameters(stiffness_g_mm=900), "A"),
    "stiffness 300 g/mm": (WorldParameters(stiffness_g_mm=300), "A"),
    "stiffening 0.3/mm": (WorldParameters(stiffening_per_mm=0.3), "A"),
    "lag 15 ms": (WorldParameters(actuator_lag_ms=15), "A"),
    "lag 50 ms": (WorldParameters(actuator_lag_ms=50), "A"),
    "dead band 2 %": (WorldParameters(dead_band=0.02), "A"),
    "dead band 20 %": (WorldParameters(dead_band=0.2), "A"),
    "stiction 5 %": (WorldParameters(stiction=0.05), "A"),
    "actuator 6 mm/s": (WorldParameters(actuator_speed_mm_s=6), "A"),
    "actuator 15 mm/s": (WorldParameters(actuator_speed_mm_s=15), "A"),
    "run-out 0.1 mm": (WorldParameters(run_out_mm=0.1), "A"),
    "backlash 0.1 mm": (WorldParameters(backlash_mm=0.1), "A"),
    "light drum, backlash": (WorldParameters(backlash_mm=0.1, drum_weight_g=800), "A"),
    "ripple 1, plate C": (WorldParameters(ripple_share=1.0), "C"),
    "cell noise 1 g, 12 ms": (WorldParameters(loadcell_noise_g=1, loadcell_average_ms=12), "A"),
    "all hard, stiff, plate C": (replace(HARD, stiffness_g_mm=900, stiffening_per_mm=0.3), "C"),
    "all hard, soft, plate C": (replace(HARD, stiffness_g_mm=300, stiffening_per_mm=0.0), "C"),
}
"""The ends of the ranges that matter to the loop, one at a time and together."""


@dataclass(frozen=True)
class Worst:
    """The worst of some trials, as shares of the set force."""

    settle_s: float
    overshoot: float
    mean_error: float
    swing: float
    unmet: str = ""

    @property
    def met(self) -> bool:
        """Whether all that is asked for was kept."""
        return not self.unmet


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_*``: nominal, drift, and the map over the plant's ranges."""
    nominal = worst_of(WorldParameters(), "A", [(v, f) for f in FORCES_G for v in SPEEDS_MM_S])
    yield from _nominal_rows(nominal)
    yield figure(
        "force_drift", drift(), "", f"{TRIALS} trials at 500 g, 120 mm/s", PREDECESSOR, 0.034
    )
    yield from map_rows({name: worst_of(*plant, list(CORNERS)) for name, plant in PLANTS.items()})


def map_rows(found: dict[str, Worst]) -> Iterator[dict[str, Any]]:
    """The share of plants that keep everything, the approach at the stiffest, and each plant."""
    share = sum(w.met for w in found.values()) / len(found)
    unmet = "; ".join(f"{n}: {w.unmet}" for n, w in found.items() if not w.met) or "none"
    yield figure(
        "force_map", share, "", f"share of {len(found)} plants that meet all; not: {unmet}"
    )
    excess = max(w.overshoot for n, w in found.items() if "stiff" in n)
    yield figure("approach_excess", excess, "", "true force over the set one, stiffest contacts")
    for name, w in found.items():
        yield figure(f"force_map.{name}", w.settle_s, "s", told(w))


def _nominal_rows(w: Worst) -> Iterator[dict[str, Any]]:
    scene = f"nominal plant, {len(FORCES_G) * len(SPEEDS_MM_S)} trials, 40–120 mm/s × 250–1000 g"
    band = f"{MEAN_MS} ms mean of the true force within ±2 %"
    yield figure("force_settle_s", w.settle_s, "s", f"{band}, from touch; {scene}")
    yield figure("force_overshoot", w.overshoot, "", scene)
    yield figure("force_mean_error", w.mean_error, "", f"inside the sync window; {scene}")
    yield figure("force_swing", w.swing, "", f"largest {MEAN_MS} ms mean off the set; {scene}")


def worst_of(plant: WorldParameters, plate: str, scenes: list[tuple[float, float]]) -> Worst:
    """Trials at every (speed, force) on one plant; a trial that ends in a fault is unmet."""
    with PlantDrum(plant, plate) as drum:
        try:
            drum.ready()
            done = [(scene, drum.trial(*scene)) for scene in scenes]
        except AssertionError as error:
            return Worst(float("inf"), 0.0, 0.0, 0.0, f"fault ({str(error)[:40]})")
    unmet = "; ".join(t for t in (_missed(*one) for one in done) if t)
    return Worst(
        settle_s=max(t.settle_s for _, t in done),
        overshoot=max(t.overshoot for _, t in done),
        mean_error=max(abs(t.mean_error) for _, t in done),
        swing=max(swing(t.window, scene[1]) for scene, t in done),
        unmet=unmet,
    )


def swing(window: NDArray[np.float64], force_g: float) -> float:
    """How far the mean of any 200 ms inside the window is off, as a share."""
    means = np.convolve(window, np.ones(MEAN_MS) / MEAN_MS, "valid") / force_g - 1
    return float(np.abs(means).max())


def _missed(scene: tuple[float, float], trial: Trial) -> str:
    """What a trial did not keep, in words; empty when it kept all."""
    missed = []
    if trial.settle_s >= SETTLE_S:
        missed.append(f"settles in {trial.settle_s:.2f} s")
    if trial.overshoot >= OVERSHOOT:
        missed.append(f"overshoots {trial.overshoot:.1%}")
    if abs(trial.mean_error) >= MEAN_ERROR:
        missed.append(f"mean off {trial.mean_error:.1%}")
    return f"{scene[0]} mm/s {scene[1]} g {', '.join(missed)}" if missed else ""


def told(w: Worst) -> str:
    """A plant's row in words."""
    kept = "all kept" if w.met else w.unmet
    return (
        f"overshoot {w.overshoot:.2%}, mean error {w.mean_error:.2%}, "
        f"swing {w.swing:.2%}; {kept}; {len(CORNERS)} trials"
    )


def drift() -> float:
    """Mean force of the last ten of 100 trials against the first ten, as a share."""
    with PlantDrum() as drum:
        drum.ready()
        means = [500 * (1 + drum.trial(120, 500).mean_error) for _ in range(TRIALS)]
    return abs(float(np.mean(means[-10:]) / np.mean(means[:10]) - 1))
