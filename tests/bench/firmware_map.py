"""What the force loop keeps over the plant's ranges, and with the settings for coarse ridges."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import Any

from tests.bench._firmware_rows import figure
from tests.bench._force_map import PLANTS, SCENE, Cell, Settings, grids, marks, off, swing
from tests.firmware.plant_drum import MEAN_MS

STEADY: Settings = {"gain_i": 500, "run_in_set": 1000, "stiffness_g_per_mm": 900}
"""For coarse ridges: learns slowly, over a longer run-in, and expects a stiff contact."""
STEADY_SAID = "gain_i_per_s 5, run_in_mm 100, stiffness_g_per_mm 900"
Plants = Iterable[tuple[str, list[Cell]]]
STIFFEST = ("stiffness 900 g/mm", "stiffening 0.3/mm", "all hard, stiff, plate C")


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_map*``, ``force_steady*`` and ``approach_excess*``."""
    yield from map_rows(grids(tuple(PLANTS), {}, "force_map"))
    yield from steady_rows(grids(tuple(PLANTS), STEADY, "force_steady"))


def map_rows(plants: Plants) -> Iterator[dict[str, Any]]:
    """Each plant as it gets done, the share that keep everything, the stiffest approach."""
    found = {}
    for name, cells in plants:
        found[name] = cells
        yield plant_row(f"force_map.{name}", cells)
    kept = sum(not any(c.missed for c in cells) for cells in found.values())
    what = f"share of {len(found)} plants that keep all in {SCENE}; the others are in the map"
    yield figure("force_map", kept / len(found), "", what)
    every = [c for cells in found.values() for c in cells]
    share = sum(not c.missed for c in every) / len(every)
    yield figure("force_map_cells", share, "", f"share of {len(every)} trials that keep all")
    stiff = [found[name] for name in STIFFEST if name in found]
    first = max(cells[0].approach_peak for cells in stiff)
    later = max(c.approach_peak for cells in stiff for c in cells[1:])
    mean = max(c.approach_mean for cells in stiff for c in cells)
    still = "true force over the set one, the drum still, stiffest contacts"
    believed = "the very first contact, believed to have 600 g/mm"
    yield figure("approach_excess_first", first, "", f"highest millisecond of {still}; {believed}")
    yield figure("approach_excess", later, "", f"highest millisecond of {still}; every later one")
    yield figure("approach_excess_mean", mean, "", f"highest {MEAN_MS} ms mean of {still}; all")


def steady_rows(plants: Plants) -> Iterator[dict[str, Any]]:
    """The same plants with the settings advised for coarse plates."""
    every: list[Cell] = []
    for name, cells in plants:
        every += cells
        yield plant_row(f"force_steady.{name}", cells)
    share = sum(not c.missed for c in every) / len(every)
    what = f"share of {len(every)} trials that keep all, with {STEADY_SAID}"
    yield figure("force_steady_cells", share, "", what)
    excess = max(c.approach_peak for c in every)
    still = "highest millisecond, the drum still, first contacts too"
    yield figure("approach_excess_steady", excess, "", f"{still}; the same trials")


def plant_row(name: str, cells: list[Cell]) -> dict[str, Any]:
    """One plant's figures and its grid of marks."""
    unmet = "; ".join(c.told for c in cells if c.missed) or "all kept"
    what = (
        f"approach {max(c.approach_peak for c in cells):.2%}, mean error {off(cells):.2%}, "
        f"swing {swing(cells):.2%}, peak in motion {max(c.motion_peak for c in cells):.0%}; {unmet}"
    )
    row = figure(name, max(c.settle_s for c in cells), "s", what)
    print(f"{name}: {marks(cells)}", file=sys.stderr, flush=True)
    return {**row, "cells": marks(cells)}
