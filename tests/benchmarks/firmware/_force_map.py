"""Measure the force loop on each plant at every speed and force, two plants in parallel."""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters
from tests.firmware.drum.support.plant_drum import MEAN_MS, PlantDrum, Trial

SPEEDS_MM_S = (40, 60, 80, 100, 120)
FORCES_G = (250, 500, 1000)
GRID = tuple((speed, force) for force in FORCES_G for speed in SPEEDS_MM_S)
SETTLE_S, OVERSHOOT, MEAN_ERROR = 1.0, 0.05, 0.01
"""Limits of a trial."""
Found = TypeVar("Found")
KEPT = "·"
MARKS = {"s": "settles late", "o": "overshoots", "m": "mean off", "f": "a fault"}
PROCESSES = 2
DRIFT_SCENE, DRIFT_TRIALS = (120, 500), 100
PLACES_MM = (10.0, 12.0, 14.0)
"""Starts of a trial after the index mark: the plate's start, and two other places on a ridge."""
SCENE = f"{len(GRID)} trials, 40–120 mm/s × 250–1000 g"
EVERYWHERE = f"{len(GRID) * len(PLACES_MM)} trials, 40–120 mm/s × 250–1000 g × 3 places of a ridge"
HARD = WorldParameters(
    actuator_lag_ms=50,
    dead_band=0.2,
    run_out_mm=0.1,
    backlash_mm=0.1,
    frame_share=0.5,
    base_height_mm=1.5,
    base_space_mm=8.0,
)
PLANTS: dict[str, tuple[WorldParameters, str]] = {
    "stiffness 900 g/mm": (WorldParameters(stiffness_g_mm=900), "A"),
    "stiffness 300 g/mm": (WorldParameters(stiffness_g_mm=300), "A"),
    "frame stiff": (WorldParameters(frame_share=0.3), "A"),
    "pressure to the 2.2": (WorldParameters(pressure_power=2.2), "A"),
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
    "plate C": (WorldParameters(), "C"),
    "plate D": (WorldParameters(), "D"),
    "cell noise 1 g, 12 ms": (WorldParameters(loadcell_noise_g=1, loadcell_average_ms=12), "A"),
    "all hard, stiff, plate D": (replace(HARD, stiffness_g_mm=900, pressure_power=2.2), "D"),
    "all hard, soft, plate D": (replace(HARD, stiffness_g_mm=300, pressure_power=1.5), "D"),
}
"""The ends of the ranges that matter to the loop, one at a time and together."""


@dataclass(frozen=True)
class Cell:
    """Result of one trial on a plant, forces relative to the set force; or its fault."""

    speed_mm_s: float
    force_g: float
    fault: str = ""
    settle_s: float = float("inf")
    approach_peak: float = 0.0
    """Highest millisecond over the set force, from touch until the drum turns."""
    approach_mean: float = 0.0
    """Highest 200 ms mean of the same time."""
    mean_error: float = 0.0
    """Error of the window's mean."""
    motion_peak: float = 0.0
    """Highest millisecond in the window, due to ridges that the loop does not follow."""
    swing: float = 0.0
    """Largest deviation of a 200 ms mean in the window."""

    @property
    def missed(self) -> str:
        """The letters of :data:`MARKS` of the missed limits."""
        if self.fault:
            return "f"
        late = self.settle_s >= SETTLE_S
        over = self.approach_peak >= OVERSHOOT
        off = abs(self.mean_error) >= MEAN_ERROR
        return "s" * late + "o" * over + "m" * off

    @property
    def missed_text(self) -> str:
        """The missed limits in words and numbers; empty if all were kept."""
        words = {
            "f": f"fault ({self.fault})",
            "s": f"settles in {self.settle_s:.2f} s",
            "o": f"overshoots {self.approach_peak:.1%}",
            "m": f"mean off {self.mean_error:.1%}",
        }
        missed = ", ".join(words[letter] for letter in self.missed)
        return f"{self.speed_mm_s:g} mm/s {self.force_g:g} g {missed}" if missed else ""


def make_cell(scene: tuple[float, float], trial: Trial) -> Cell:
    """Return the figures of a trial."""
    speed_mm_s, force_g = scene
    means = moving_mean(trial.window) / force_g - 1
    return Cell(
        speed_mm_s,
        force_g,
        settle_s=trial.settle_s,
        approach_peak=trial.overshoot,
        approach_mean=trial.approach_mean,
        mean_error=trial.mean_error,
        motion_peak=float(trial.window.max() / force_g - 1),
        swing=float(np.abs(means).max()),
    )


def moving_mean(forces: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the means over 200 ms, (n − 199,), of the forces of n milliseconds."""
    return np.convolve(forces, np.ones(MEAN_MS) / MEAN_MS, "valid")


def measure_cells(
    plant: WorldParameters,
    plate: str,
    scenes: tuple[tuple[float, float], ...] = GRID,
    begin_mm: float = PLACES_MM[0],
) -> list[Cell]:
    """Run trials on one plant in sequence; restart the drum after a fault."""
    done: list[Cell] = []
    while len(done) < len(scenes):
        with PlantDrum(plant, plate, begin_mm=begin_mm) as drum:
            try:
                drum.prepare()
                for scene in scenes[len(done) :]:
                    trial = drum.trial(*scene)
                    done.append(make_cell(scene, trial))
            except AssertionError as error:
                done.append(Cell(*scenes[len(done)], fault=str(error)[:40] or "refused"))
    return done


def measure_all_places(plant: WorldParameters, plate: str) -> list[Cell]:
    """Run the grid from each starting place, each time on a new drum."""
    return [cell for mm in PLACES_MM for cell in measure_cells(plant, plate, begin_mm=mm)]


def mean_errors(plant: WorldParameters, plate: str) -> NDArray[np.float64]:
    """Return the relative error of the window's mean in a hundred trials, (100,)."""
    with PlantDrum(plant, plate) as drum:
        drum.prepare()
        return np.array([drum.trial(*DRIFT_SCENE).mean_error for _ in range(DRIFT_TRIALS)])


def for_each_plant(
    work: Callable[[WorldParameters, str], Found],
    title: str,
    nominal: tuple[WorldParameters, str] | None = None,
) -> Iterator[tuple[str, Found]]:
    """Yield each plant's name and result of ``work`` as they finish, and print the progress.

    ``nominal`` is an additional plant, named "".
    """
    plants = PLANTS if nominal is None else {"": nominal, **PLANTS}
    names = tuple(plants)
    begun_s = time.monotonic()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(PROCESSES, mp_context=context) as pool:
        jobs = {pool.submit(work, *plants[name]): name for name in names}
        for n, job in enumerate(as_completed(jobs), 1):
            passed_s = time.monotonic() - begun_s
            left_s = passed_s * (len(names) - n) / n
            progress = f"{title}: {n} of {len(names)} plants, {left_s:.0f} s left"
            print(progress, file=sys.stderr, flush=True)
            yield jobs[job], job.result()


def marks(cells: list[Cell]) -> dict[str, list[str]]:
    """Return for each force the marks of all speeds: all limits missed from any place."""
    missed: dict[tuple[float, float], str] = {}
    for cell in cells:
        scene = (cell.force_g, cell.speed_mm_s)
        missed[scene] = "".join(m for m in MARKS if m in missed.get(scene, "") + cell.missed)
    return {
        f"{force_g} g": [
            letters or KEPT for (force, _), letters in missed.items() if force == force_g
        ]
        for force_g in FORCES_G
    }


def largest_mean_error(cells: list[Cell]) -> float:
    """Return the largest error of a window's mean."""
    return max(abs(c.mean_error) for c in cells)


def largest_swing(cells: list[Cell]) -> float:
    """Return the largest deviation of a 200 ms mean in a window."""
    return max(c.swing for c in cells)
