"""Force scaling on slides: the tables say what was measured, on a plate that is known."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.reading import Reading
from tools.force_invariance import (
    LEVELS_G,
    MARK,
    PAGE,
    TASKS,
    Calibration,
    Measured,
    estimate_table,
    gain_table,
    table,
)

LOW = 80.0
FOUND = Calibration(LOW + np.linspace(1.0, 3.0, 18) * LEVELS_G[:, None] ** 0.8)
RANGES = Normalisation(
    np.full(18, LOW, np.uint16), np.full(18, 4000, np.uint16), "made", Reading.CONDUCTANCE
)


def measured(original: float, divided: float) -> Measured:
    """Return a session with one accuracy for each task."""
    accuracy = {
        (name, scaled): dict.fromkeys((task.key for task in TASKS), value)
        for scaled in (False, True)
        for name, value in (("Original", original), ("Divided", divided))
    }
    return Measured(accuracy, {250.0: (0.98, 0.03)})


def test_factors_undo_the_force_on_the_smooth_plate() -> None:
    for each in (False, True):
        factors = FOUND.factors(LEVELS_G, RANGES, each=each)
        scaled = factors * (FOUND.curves - LOW)
        aim = [np.interp(500.0, LEVELS_G, curve - LOW) for curve in FOUND.curves.T]
        assert scaled == pytest.approx(np.tile(aim, (len(LEVELS_G), 1)))


def test_the_estimate_is_the_force_on_the_smooth_plate() -> None:
    readings = np.tile(np.round(FOUND.curves[7]).astype(np.uint16), (50, 1))
    assert FOUND.estimated_g(readings) == pytest.approx(LEVELS_G[7], rel=0.01)


def test_tables_have_means_each_seed_and_gains() -> None:
    sessions = [measured(80.0, 90.0), measured(60.0, 90.0)]
    lines = table(sessions).splitlines()
    assert lines[2].startswith("| Original | plain | 70.0 (80, 60) |")
    gains = gain_table(sessions).splitlines()
    assert [line.split(" | ")[2] for line in gains[2:]] == ["+10.0", "+30.0"]
    assert "0.98 ± 0.030" in estimate_table(sessions)


def test_the_page_has_the_tables() -> None:
    head, mark, tables = PAGE.read_text(encoding="utf-8").partition(MARK)
    assert mark and tables.count("| Divided |") == 2 + 3 and "What limits it" in head
