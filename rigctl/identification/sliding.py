"""Recordings of the paper's conditions without a board: plates pressed at a force and slid.

Plant, contact and skin are those of the bench. Only the force is not regulated: the rod stands at
the travel at which the plate carries it in the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.classification.splits import Design
from rigctl.simulation.bench.contact import contact_tables, footprint, mounted
from rigctl.simulation.bench.mechanics import Mechanics, RodMotion
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.bench.skin import SLOT_US, Skin
from rigctl.simulation.bench.textures import CATALOGUE, GRID_MM

SPEEDS_MM_S = (40.0, 60.0, 80.0, 100.0, 120.0)
FORCES_G = (250.0, 500.0, 1000.0)
TRAVEL_MM = 240.0
LIFTED_MS, RESTING_MS, RUN_IN_MM = 600, 300, 30.0
WINDOW_MM = 100.0
"""From the plate's start to where a rig begins to record."""

STRETCH_MS = 1000

Samples = NDArray[np.uint16]


class Slides(NamedTuple):
    """Trials of one session: counts uint16 (n, 18) each, in the order of the readings.

    ``swing``: rms of the force over the plate that swings most, as a share, under the least force.
    """

    samples: list[Samples]
    design: Design
    swing: float


class Slider:
    """A bench whose rod is put where it should be, with one sensor for the whole session."""

    def __init__(self, parameters: WorldParameters, seed: int) -> None:
        # A force loop follows the run-out and knows of no play; here is neither loop nor play.
        self._p = replace(parameters, run_out_mm=0.0, backlash_mm=0.0)
        self._seed = seed
        self._plant = Mechanics(self._p)
        self._skin = Skin(self._p, seed, self._plant)
        self._frames = 0
        # A bench begins with a plate; so these sit as those of a virtual set of the same seed do.
        self._mountings = 1
        self.swing = 0.0

    def mount(self, plate: str) -> None:
        """Snap in a plate; it sits as no other mounting does."""
        seat = mounted(self._p, self._seed, self._mountings)
        self._mountings += 1
        tables = contact_tables(plate, self._p)
        self._footprint = footprint(tables, self._p, seat)
        self._skin.set_plate(tables, seat)
        self._plant.set_footprint(self._footprint)
        row = round(self._footprint.travel_mm(min(FORCES_G)) / self._footprint.cell_mm)
        begin, end = self._p.plate_start_mm, self._p.plate_start_mm + self._p.plate_length_mm
        force = self._footprint.force_g[row, round(begin / GRID_MM) : round(end / GRID_MM)]
        self.swing = max(self.swing, float(force.std() / force.mean()))

    def trial(self, speed_mm_s: float, force_g: float) -> Samples:
        """A new contact, and what is read over the paper's travel at a speed."""
        start_mm = self._p.plate_start_mm + WINDOW_MM - RUN_IN_MM - self._p.start_mm
        standing = RodMotion(0.0, start_mm, 0.0)
        self._plant.put_rod(0.0)
        self._pass(LIFTED_MS, standing)
        self._plant.put_rod(self._p.contact_mm + self._footprint.travel_mm(force_g))
        self._pass(RESTING_MS, standing)
        moving = RodMotion(1000.0 * self._plant.time_ms, start_mm, speed_mm_s)
        self._pass(round(1000 * RUN_IN_MM / speed_mm_s), moving)
        left, parts = round(1000 * TRAVEL_MM / speed_mm_s), []
        while left:
            parts.append(self._read(min(left, STRETCH_MS), moving))
            left -= len(parts[-1])
        return np.concatenate(parts)

    def _read(self, count: int, motion: RodMotion) -> Samples:
        starts = 1000.0 * (self._plant.time_ms + np.arange(count, dtype=np.float64))
        self._pass(count, motion)
        self._frames += count
        return self._skin.read(self._frames - count, starts - 1000.0, float(SLOT_US))

    def _pass(self, count: int, motion: RodMotion) -> None:
        end_ms = self._plant.time_ms + count
        while self._plant.time_ms < end_ms:
            until_ms = min(end_ms, self._plant.time_ms + STRETCH_MS)
            while self._plant.time_ms < until_ms:
                self._plant.advance(until_ms, 0.0, motion)
            self._skin.advance()


def slide(parameters: WorldParameters, repeats: int, seeds: Sequence[int]) -> list[Slides]:
    """A session a seed: every plate mounted once, every condition as often as is asked."""
    sliders = [Slider(parameters, seed) for seed in seeds]
    samples: list[list[Samples]] = [[] for _ in seeds]
    conditions = []
    for number, plate in enumerate(CATALOGUE):
        asked = [(number, v, f) for f in FORCES_G for v in SPEEDS_MM_S for _ in range(repeats)]
        conditions += asked
        for slider, kept in zip(sliders, samples, strict=True):
            slider.mount(plate)
            kept += [slider.trial(v, f) for _, v, f in asked]
    texture, speed, force = np.array(conditions).T
    design = Design(tuple(CATALOGUE), texture.astype(np.int64), speed, force)
    return [Slides(kept, design, s.swing) for s, kept in zip(sliders, samples, strict=True)]
