"""Values older than their limit are grey and say their age, each for its own source."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from gui.widgets.data_ages import STALE_S, stale_words
from rigctl.boards.drum_states import State
from rigctl.errors import LinkLost
from tests.gui.steps import Harness, wait_until

LIVE = {"poll_age_s": 0.02, "loadcell_age_s": 0.02, "last_block_age_s": 0.02}


def test_the_limit_is_below_half_a_second() -> None:
    assert STALE_S < 0.5


@pytest.mark.parametrize(
    ("old", "stale"),
    [
        ({}, set()),
        ({"poll_age_s": 1.2, "loadcell_age_s": 1.2}, {"heading", "readings", "force", "speed"}),
        ({"loadcell_age_s": 1.2}, {"force reading", "force"}),
        ({"last_block_age_s": 1.2}, {"taxels"}),
    ],
)
def test_each_source_that_is_gone_turns_what_it_feeds_grey(
    harness: Harness, old: dict[str, float], stale: set[str]
) -> None:
    harness.update(state=int(State.HOLD), **{**LIVE, **old})
    assert _stale(harness) == stale
    harness.update(**LIVE)
    assert _stale(harness) == set()


def test_a_silent_engine_turns_everything_grey_with_its_age(harness: Harness) -> None:
    harness.update(state=int(State.HOLD), **LIVE)
    window = harness.window
    wait_until(lambda: window.health_strip.cells["rate"].value.text() == "–")
    assert _stale(harness) == {"heading", "readings", "force", "speed", "taxels"}
    assert window.toolbar.state_words.text().endswith("s old")
    assert window.operate_panel.reading_box.age.text().startswith("Not live: 0.")
    assert window.live_plots.stale_covers.force.text.endswith("s old")


def test_plots_of_a_lost_engine_stay_grey_and_grow_old(harness: Harness) -> None:
    harness.engine.write_samples(500)
    harness.update(**LIVE)
    harness.engine.failure = LinkLost("the engine ended")
    harness.window.poll()
    covers = harness.window.live_plots.stale_covers
    wait_until(lambda: bool(covers.force.text and covers.taxels[0].text))
    assert covers.taxels[0].isVisible()


def test_what_a_lost_drum_showed_is_shown_as_old(harness: Harness) -> None:
    harness.update(state=int(State.HOLD), **LIVE)
    harness.update(drum_connected=False, poll_age_s=3.0, loadcell_age_s=3.0)
    box = harness.window.operate_panel.reading_box
    assert box.readings["Force"].text() == "0.4 g"
    assert box.readings["Force"].property("role") == "stale"
    assert re.fullmatch(r"Not live: [3-9]\.\d s old", box.age.text())


def test_the_force_axis_shows_negative_readings(harness: Harness) -> None:
    force = harness.window.live_plots.time_plots.force
    at = np.linspace(-2.0, 0.0, 50)
    force.refresh(at, np.full(50, 120.0), np.full(50, 0.0))
    assert force.values == (0.0, 150.0)
    force.refresh(at, np.full(50, -80.0), np.full(50, 0.0))
    low, high = force.values
    assert low <= -80.0 and high >= 0.0


def _stale(harness: Harness) -> set[str]:
    """Return what is grey now."""
    window: Any = harness.window
    readings = window.operate_panel.reading_box.readings
    covers = window.live_plots.stale_covers
    is_stale = {name: label.property("role") == "stale" for name, label in readings.items()}
    found = {
        "heading": window.toolbar.state.property("level") == "stale",
        "readings": is_stale["Speed"] and is_stale["Force"],
        "force reading": is_stale["Force"] and not is_stale["Speed"],
        "force": covers.force.isVisible(),
        "speed": covers.drum.isVisible(),
        "taxels": all(cover.isVisible() for cover in covers.taxels),
    }
    return {name for name, is_old in found.items() if is_old}


def test_an_age_of_minutes_is_short() -> None:
    words = [stale_words(age_s) for age_s in (0.4, 3.04, 12.0, 136.0, 3700.0)]
    assert words == ["", "3.0 s old", "12 s old", "2 min old", "1 h 01 min old"]
