"""Trials of the simulated bench without a force loop: the rod is put where the press needs it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.trial_set import Design
from rigctl.bench.contact import REFERENCE_FORCE_G, contact_tables, draw_mounting, force_table
from rigctl.bench.mechanics import DrumTrajectory, Mechanics, drag_speed_mm_s
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.skin import SLOT_US, Skin
from rigctl.bench.textures import CATALOGUE, GRID_MM
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.encoder.batch import common_bin_edges, count_spikes, features_from_counts
from rigctl.encoder.features import UNSCALED, FeatureLayout
from rigctl.encoder.normalisation import Normalisation

SPEEDS_MM_S = (40.0, 60.0, 80.0, 100.0, 120.0)
FORCES_G = (250.0, 500.0, 1000.0)
DEPTHS_MM = (1.2, 1.5, 1.8, 2.1)
TRAVEL_MM = 240.0
LIFTED_MS, RESTING_MS, RUN_IN_MM = 1600, 850, 100.0
"""As long as a rig is lifted, rests in contact and runs in, because the skin relaxes meanwhile."""
WINDOW_MM = 100.0
"""Distance from the plate's start to the start of a rig's recording."""

CHUNK_MS = 1000
CONTACT_G = 8.0
"""Force at which the drum's board finds contact, from which it counts depths."""

Samples = NDArray[np.uint16]
Floats = NDArray[np.float64]


class SlideSession(NamedTuple):
    """Trials of one session: counts uint16 (n, 18) each, in the order of the readings.

    ``swing``: relative rms of the force over the plate under the lowest force, for the worst plate.
    """

    samples: list[Samples]
    design: Design
    swing: float


class Slider:
    """A bench whose rod is set directly, with one sensor for the whole session.

    Depths count from the contact that the drum's board finds, as in the force mode ``position``,
    or with a ``height_spread_mm`` from a fixed zero, and the plates' heights differ by that much.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, height_spread_mm: float | None = None
    ) -> None:
        # There is no force loop here to compensate run-out and backlash, so both are 0.
        self._p = replace(parameters, run_out_mm=0.0, backlash_mm=0.0)
        self._seed = seed
        self._plant = Mechanics(self._p)
        self._skin = Skin(self._p, seed, self._plant)
        self._frames = 0
        # A bench mounts a plate at power-up. Counting it gives the alignments of the same seed.
        self._mountings = 1
        self._height_spread_mm = height_spread_mm
        self._heights = np.random.default_rng(seed)
        self.swing = 0.0

    def mount(self, plate: str) -> None:
        """Mount a plate with a new alignment."""
        mounting = draw_mounting(self._p, self._seed, self._mountings)
        self._mountings += 1
        tables = contact_tables(plate, self._p)
        self._table = force_table(tables, self._p, mounting)
        self._skin.set_plate(tables, mounting)
        self._plant.set_force_table(self._table)
        self._zero_mm = self._table.travel_mm(CONTACT_G)
        if self._height_spread_mm is not None:
            self._zero_mm = self._height_spread_mm * float(self._heights.standard_normal())
        row = round(self._table.travel_mm(min(FORCES_G)) / self._table.cell_mm)
        begin, end = self._p.plate_start_mm, self._p.plate_start_mm + self._p.plate_length_mm
        force = self._table.force_g[row, round(begin / GRID_MM) : round(end / GRID_MM)]
        self.swing = max(self.swing, float(force.std() / force.mean()))

    def trial(self, speed_mm_s: float, force_g: float) -> Samples:
        """Return the readings over the paper's travel at a speed and a force of the load cell."""
        share_per_g = (
            self._p.loadcell_drag * drag_speed_mm_s(speed_mm_s) / 100.0 / REFERENCE_FORCE_G
        )
        # The root of contact · (1 + share · contact) = force that is the force without drag.
        contact_g = 2.0 * force_g / (1.0 + math.sqrt(1.0 + 4.0 * share_per_g * force_g))
        return self._slide(speed_mm_s, self._table.travel_mm(contact_g))

    def trial_at_depth(self, speed_mm_s: float, depth_mm: float) -> Samples:
        """Return the same, pressed to a depth."""
        return self._slide(speed_mm_s, self._zero_mm + depth_mm)

    def _slide(self, speed_mm_s: float, travel_mm: float) -> Samples:
        """Make a new contact and return the readings."""
        start_mm = self._p.plate_start_mm + WINDOW_MM - RUN_IN_MM - self._p.start_mm
        at_start = DrumTrajectory(0.0, start_mm, 0.0)
        self._plant.set_rod(0.0)
        self._advance(LIFTED_MS, at_start)
        self._plant.set_rod(self._p.contact_mm + travel_mm)
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
    parameters: WorldParameters,
    repeats: int,
    seeds: Sequence[int],
    depths_mm: Sequence[float] = (),
    height_spread_mm: float | None = None,
) -> list[SlideSession]:
    """Return a session per seed: every plate mounted once, every condition ``repeats`` times.

    Depths, if there are any, replace the forces and stand in their place in the design.
    """
    sliders = [Slider(parameters, seed, height_spread_mm) for seed in seeds]
    samples: list[list[Samples]] = [[] for _ in seeds]
    conditions = []
    for number, plate in enumerate(CATALOGUE):
        presses = depths_mm or FORCES_G
        rows = [(number, v, f) for f in presses for v in SPEEDS_MM_S for _ in range(repeats)]
        conditions += rows
        for slider, trials in zip(sliders, samples, strict=True):
            slider.mount(plate)
            press = slider.trial_at_depth if depths_mm else slider.trial
            trials += [press(v, f) for _, v, f in rows]
    texture, speed, force = np.array(conditions).T
    design = Design(tuple(CATALOGUE), texture.astype(np.int64), speed, force)
    return [
        SlideSession(trials, design, slider.swing)
        for slider, trials in zip(sliders, samples, strict=True)
    ]


def slide_features(
    slides: SlideSession, layout: FeatureLayout = UNSCALED, c: Floats | None = None
) -> Floats:
    """Return features in the windows of a layout, by default 100 ms of real time.

    Float64 (n_trials, n_features). ``c``: factors on the SA current, float64 (n_trials, n_taxels).
    """
    ranges = Normalisation.from_samples(slides.samples, "all trials")
    out = np.empty((len(slides.samples), layout.n_features(PAPER_ARRAY.count)))
    for speed in np.unique(slides.design.speed_mm_s):
        rows = np.flatnonzero(slides.design.speed_mm_s == speed)
        trials = [slides.samples[row] for row in rows]
        lengths = [len(trial) for trial in trials]
        cuts = common_bin_edges([layout], max(lengths), float(speed))
        counts = count_spikes(trials, cuts, ranges, sa_scale=None if c is None else c[rows])
        out[rows] = features_from_counts(counts, cuts, lengths, float(speed), layout)
    return out
