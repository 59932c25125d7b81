"""The page of the firmware's figures is rendered from rows, and its tables are up to date."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.config.resources import checkout
from tests.benchmarks.firmware._firmware_rows import GRBL, figure
from tests.benchmarks.firmware._force_map import Cell, marks
from tests.benchmarks.firmware.firmware_drift import drift_rows
from tests.firmware import page
from tests.firmware.drum.support.checks import CONTROLS

ROWS = [
    figure("idle_share", 0.6174, "", "asleep"),
    figure("max_steps_per_s", 10_240.0, "steps/s", "in contact", GRBL, 3e4),
    figure("free_stack_bytes", 5000, "bytes", "never used of 8192, build 0badcafe; runs"),
    {
        **figure("force_map.lag 50 ms", 0.456, "s", "all kept"),
        "cells": {"250 g": list("····m"), "500 g": list("·····"), "1000 g": ["so", *"····"]},
    },
]


def test_rows_are_rendered_with_units_percentages_and_peers() -> None:
    text = page.page(ROWS)
    assert "| `idle_share` | 61.74 % | ≥ 50 % | asleep |" in text
    assert "10,240 steps/s" in text and "30,000 steps/s, grbl" in text
    assert "build `0badcafe`" in text
    assert "| lag 50 ms | 0.46 | · · · · m | · · · · · | so · · · · | all kept |" in text


def test_a_trial_has_a_mark_for_each_missed_limit() -> None:
    kept = Cell(40, 250, settle_s=0.5, approach_peak=0.02, mean_error=-0.004)
    elsewhere = Cell(40, 250, settle_s=0.5, approach_peak=0.06, mean_error=-0.004)
    missed = Cell(120, 250, settle_s=1.2, approach_peak=0.16, mean_error=-0.05)
    fault = Cell(40, 500, fault="ACTUATOR_END")
    assert marks([kept, missed, fault]) == {"250 g": ["·", "som"], "500 g": ["f"], "1000 g": []}
    assert marks([kept, missed, elsewhere])["250 g"] == ["o", "som"]
    assert (
        missed.missed_text == "120 mm/s 250 g settles in 1.20 s, overshoots 16.0%, mean off -5.0%"
    )
    assert not kept.missed_text and "ACTUATOR_END" in fault.missed_text


def test_plants_with_a_drifting_force_are_named() -> None:
    steady, late = np.full(10, 0.001), np.array([*[0.0] * 9, 0.012])
    rows = {r["name"]: r for r in drift_rows({"": steady, "soft": -steady, "hard": late})}
    assert rows["firmware.drum.force_drift"]["value"] == 0
    worst = rows["firmware.drum.force_drift_worst"]
    assert worst["value"] == pytest.approx(0.012) and "not kept by hard 1.20%" in worst["note"]
    assert "soft" not in worst["note"]
    assert rows["firmware.drum.force_lasting_error"]["value"] == 0.012


def test_without_figures_there_is_no_page() -> None:
    with pytest.raises(ValueError, match="benchmarks firmware"):
        page.page([])


def test_the_page_in_the_docs_has_the_current_controls_and_cells() -> None:
    root = checkout()
    assert root is not None
    text = (root / "docs/reference/firmware.md").read_text(encoding="utf-8")
    assert page.controls() in text
    assert page.cells() in text
    assert all(name in text for name, *_ in CONTROLS)
