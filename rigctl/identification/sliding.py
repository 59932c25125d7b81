"""Simulate recordings of the paper's conditions without boards: plates pressed and slid.

Mechanics, contact and skin are those of the bench, but no loop controls the force: the rod is fixed
at the travel at which the plate's mean force is the set force.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.splits import Design
from rigctl.simulation.bench.contact import contact_tables, draw_mounting, force_table
from rigctl.simulation.bench.mechanics import DrumTrajectory, Mechanics
from rigctl.simulation.bench.skin import SLOT_US, Skin
from rigctl.simulation.bench.textures import CATALOGUE, GRID_MM
from rigctl.simulation.bench.world.parameters import WorldParameters

SPEEDS_MM_S = (40.0, 60.0, 80.0, 100.0, 120.0)
FORCES_G = (250.0, 500.0, 1000.0)
TRAVEL_MM = 240.0
LIFTED_MS, RESTING_MS, RUN_IN_MM = 600, 300, 30.0
WINDOW_MM = 100.0
"""Distance from the plate's start to the start of a rig's recording."""

CHUNK_MS = 1000

Samples = NDArray[np.uint16]


class SlideSession(NamedTuple):
    """Trials of one session: counts uint16 (n, 18) each, in the order of the readings.

    ``swing``: relative rms of the force over the plate under the lowest force, for the worst plate.
    """

    samples: list[Samples]
    design: Design
    swing: float


class Slider:
    """A bench whose rod is set directly, with one sensor for the whole session."""

    def __init__(self, parameters: WorldParameters, seed: int) -> None:
        # There is no force loop here to compensate run-out and backlash, so both are 0.
        self._p = replace(parameters, run_out_mm=0.0, backlash_mm=0.0)
        self._seed = seed
        self._plant = Mechanics(self._p)
        self._skin = Skin(self._p, seed, self._plant)
        self._frames = 0
        # A bench mounts a plate at power-up. Counting it gives the alignments of the same seed.
        self._mountings = 1
        self.swing = 0.0

    def mount(self, plate: str) -> None:
        """Mount a plate with a new alignment."""
        mounting = draw_mounting(self._p, self._seed, self._mountings)
        self._mountings += 1
        tables = contact_tables(plate, self._p)
        self._table = force_table(tables, self._p, mounting)
        self._skin.set_plate(tables, mounting)
        self._plant.set_force_table(self._table)
        row = round(self._table.travel_mm(min(FORCES_G)) / self._table.cell_mm)
        begin, end = self._p.plate_start_mm, self._p.plate_start_mm + self._p.plate_length_mm
        force = self._table.force_g[row, round(begin / GRID_MM) : round(end / GRID_MM)]
        self.swing = max(self.swing, float(force.std() / force.mean()))

    def trial(self, speed_mm_s: float, force_g: float) -> Samples:
        """Make a new contact and return the readings over the paper's travel at a speed."""
        start_mm = self._p.plate_start_mm + WINDOW_MM - RUN_IN_MM - self._p.start_mm
        at_start = DrumTrajectory(0.0, start_mm, 0.0)
        self._plant.set_rod(0.0)
        self._advance(LIFTED_MS, at_start)
        self._plant.set_rod(self._p.contact_mm + self._table.travel_mm(force_g))
        self._advance(RESTING_MS, at_start)
        moving = DrumTrajectory(1000.0 * self._plant.time_ms, start_mm, speed_mm_s)
        self._advance(round(1000 * RUN_IN_MM / speed_mm_s), moving)
        left, chunks = round(1000 * TRAVEL_MM / speed_mm_s), []
        while left:
            chunks.append(self._read(min(left, CHUNK_MS), moving))
            left -= len(chunks[-1])
        return np.concatenate(chunks)

    def _read(self, count: int, trajectory: DrumTrajectory) -> Samples:
        starts = 1000.0 * (self._plant.time_ms + np.arange(count, dtype=np.float64))
        self._advance(count, trajectory)
        self._frames += count
        return self._skin.read(self._frames - count, starts - 1000.0, float(SLOT_US))

    def _advance(self, count: int, trajectory: DrumTrajectory) -> None:
        end_ms = self._plant.time_ms + count
        while self._plant.time_ms < end_ms:
            self._plant.advance(min(end_ms, self._plant.time_ms + CHUNK_MS), 0.0, trajectory)
            self._skin.advance()


def simulate_slides(
    parameters: WorldParameters, repeats: int, seeds: Sequence[int]
) -> list[SlideSession]:
    """Return a session per seed: every plate mounted once, every condition ``repeats`` times."""
    sliders = [Slider(parameters, seed) for seed in seeds]
    samples: list[list[Samples]] = [[] for _ in seeds]
    conditions = []
    for number, plate in enumerate(CATALOGUE):
        rows = [(number, v, f) for f in FORCES_G for v in SPEEDS_MM_S for _ in range(repeats)]
        conditions += rows
        for slider, trials in zip(sliders, samples, strict=True):
            slider.mount(plate)
            trials += [slider.trial(v, f) for _, v, f in rows]
    texture, speed, force = np.array(conditions).T
    design = Design(tuple(CATALOGUE), texture.astype(np.int64), speed, force)
    return [
        SlideSession(trials, design, slider.swing)
        for slider, trials in zip(sliders, samples, strict=True)
    ]
