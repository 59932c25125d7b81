"""Measure the force loop over the plant's ranges, with the board's boot settings."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import Any

from tests.benchmarks.firmware._firmware_rows import figure
from tests.benchmarks.firmware._force_map import (
    EVERYWHERE,
    Cell,
    for_each_plant,
    largest_mean_error,
    largest_swing,
    marks,
    measure_all_places,
)
from tests.firmware.drum.support.plant_drum import MEAN_MS

Plants = Iterable[tuple[str, list[Cell]]]


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``firmware.drum.force_map*`` and ``approach_excess*``."""
    yield from map_rows(for_each_plant(measure_all_places, "force_map"))


def map_rows(plants: Plants) -> Iterator[dict[str, Any]]:
    """Yield each plant as it finishes, then the shares that keep all limits and the worst cases."""
    found = {}
    for name, cells in plants:
        found[name] = cells
        yield plant_row(f"force_map.{name}", cells)
    every = [c for cells in found.values() for c in cells]
    kept = sum(not any(c.missed for c in cells) for cells in found.values())
    what = f"share of {len(found)} plants that keep all in {EVERYWHERE}"
    yield figure("force_map", kept / len(found), "", what)
    share = sum(not c.missed for c in every) / len(every)
    yield figure("force_map_cells", share, "", f"share of {len(every)} trials that keep all")
    settle_s = max(c.settle_s for c in every)
    yield figure("force_map_settle_s", settle_s, "s", f"the slowest of {len(every)} trials")
    yield figure(
        "force_map_mean_error",
        largest_mean_error(every),
        "",
        f"the farthest of {len(every)} trials",
    )
    still = "of true force over the set one, the drum still, first contacts too"
    peak = max(c.approach_peak for c in every)
    yield figure("approach_excess", peak, "", f"highest millisecond {still}; {len(every)} trials")
    mean = max(c.approach_mean for c in every)
    yield figure("approach_excess_mean", mean, "", f"highest {MEAN_MS} ms mean {still}")


def plant_row(name: str, cells: list[Cell]) -> dict[str, Any]:
    """Return one plant's figures and its grid of marks."""
    unmet = "; ".join(c.missed_text for c in cells if c.missed) or "all kept"
    approach = max(c.approach_peak for c in cells)
    motion = max(c.motion_peak for c in cells)
    what = (
        f"approach {approach:.2%}, mean error {largest_mean_error(cells):.2%}, "
        f"swing {largest_swing(cells):.2%}, peak in motion {motion:.0%}; {unmet}"
    )
    row = figure(name, max(c.settle_s for c in cells), "s", what)
    print(f"{name}: {marks(cells)}", file=sys.stderr, flush=True)
    return {**row, "cells": marks(cells)}
