"""Plate, velocity, spikes in scaled time and health of the moving finger."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QScrollArea

from gui.finger.scan_plots import SPAN_MM
from gui.live.health import finger_readings
from gui.widgets.labels import Level
from rigctl.finger.status import parse_finger_status
from tests.gui.fake_finger import RUNNING, STATUS
from tests.gui.steps import FingerWindow


def _spike(n: int, **at: int) -> np.ndarray:
    """Return (n, 9) without spikes but one of each taxel ``t1`` … at a sample."""
    spikes = np.zeros((n, 9), np.uint8)
    for name, sample in at.items():
        spikes[sample, int(name[1:]) - 1] = 1
    return spikes


def _ticks_mm(finger: FingerWindow) -> dict[int, list[float]]:
    """Return where each taxel, from 1, has ticks, in mm."""
    ticks = finger.tab.view.plots.raster.ticks
    mm_per_column = SPAN_MM / ticks.shape[1]
    rows = enumerate(ticks, start=1)
    return {t: (np.flatnonzero(row) * mm_per_column).tolist() for t, row in rows if row.any()}


def test_spikes_stand_at_the_way_that_the_finger_had_made(finger: FingerWindow) -> None:
    engine = finger.engine
    engine.send_instruction("B", "slow-to-fast")
    engine.write_samples(_spike(50, t1=10), in_scan=False)
    engine.write_samples(_spike(300, t1=50, t5=150, t9=249), in_scan=True, first=True)
    engine.send_batch(1, 50.0, 5.0)
    engine.send_batch(2, 100.0, 15.0)
    finger.update(run=RUNNING)
    found = _ticks_mm(finger)
    assert set(found) == {1, 5}  # the batch of the third has no velocity yet
    assert found[1] == pytest.approx([2.5], abs=1)
    assert found[5] == pytest.approx([10.0], abs=1)
    engine.send_batch(3, 200.0, 35.0)
    finger.window.poll()
    assert _ticks_mm(finger)[9] == pytest.approx([24.9], abs=1)
    assert finger.tab.view.plots.shown_velocities_mm_s == [50.0, 100.0, 200.0]


def test_last_scan_stays_until_the_next_has_a_velocity(finger: FingerWindow) -> None:
    engine = finger.engine
    engine.write_samples(_spike(100, t2=50), in_scan=True, first=True)
    engine.send_batch(1, 100.0, 10.0)
    finger.window.poll()
    before = _ticks_mm(finger)
    assert set(before) == {2}
    engine.write_samples(_spike(500), in_scan=False)
    engine.write_samples(_spike(60, t7=5), in_scan=True, first=True)
    finger.window.poll()
    assert _ticks_mm(finger) == before
    engine.write_samples(_spike(60), in_scan=True)
    engine.scan = 2
    engine.send_batch(1, 100.0, 10.0)
    finger.window.poll()
    assert set(_ticks_mm(finger)) == {7}


def test_window_that_joins_in_a_scan_shows_what_it_knows(finger: FingerWindow) -> None:
    engine = finger.engine
    engine.write_samples(_spike(400, t1=50, t2=350), in_scan=True, first=True)
    engine.send_batch(4, 100.0, 40.0)
    finger.window.poll()
    assert set(_ticks_mm(finger)) == {2}
    assert _ticks_mm(finger)[2] == pytest.approx([35.0], abs=1)


def test_the_velocity_names_its_scan_also_when_the_next_one_is_asked_for(
    finger: FingerWindow,
) -> None:
    assert finger.tab.view.velocity_title.text() == "Velocity"
    finger.engine.send_instruction("D", "fast-to-slow")
    finger.engine.send_batch(1, 90.0, 9.0)
    finger.engine.send_instruction("B", "slow")
    finger.window.poll()
    title = finger.tab.view.velocity_title.text()
    assert title.startswith("Velocity in scan 1 (plate D), planned: fast-to-slow (first half at ")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, "in contact, along 120 mm, across −3 mm"),
        ({"in_contact": False}, "not in contact, along 120 mm, across −3 mm"),
        ({"position_valid": False}, "tracker lost"),
        ({"tracker_connected": False}, "no position"),
    ],
)
def test_plate_says_where_the_finger_is(
    finger: FingerWindow, changes: dict[str, Any], words: str
) -> None:
    finger.update(**changes)
    assert finger.tab.view.plate.words == words


def test_path_begins_with_the_slide(finger: FingerWindow) -> None:
    engine, plate = finger.engine, finger.tab.view.plate
    for number in range(30):
        engine.write_position(number / 10, 100.0 * number, valid=number != 25)
    engine.send_event("instruction", "slide", event_s=2.0, texture="B", profile="slow")
    finger.window.poll()
    assert plate.path_mm[0].tolist() == [2000.0, 1.0]
    assert 2500.0 not in plate.path_mm[:, 0].tolist()


@pytest.mark.parametrize(
    ("cell", "changes", "text", "level"),
    [
        ("rate", {}, "1000 Hz", Level.OK),
        ("rate", {"sample_rate_hz": 940.0}, "940 Hz", Level.BAD),
        ("lost", {"lost_samples": 3, "lost_age_s": 9.0}, "3", Level.BAD),
        ("tracker", {"position_age_s": 0.4}, "400 ms", Level.BAD),
        ("tracker", {"position_valid": False}, "lost", Level.BAD),
        ("dropouts", {"dropouts": 2}, "2", Level.WARN),
        ("outliers", {"outliers": 5}, "5", Level.WARN),
        ("late", {"late_velocities": 1}, "1", Level.WARN),
        ("features", {}, "–", Level.OFF),
        ("features", {"latency_p99_ms": {"features": 6.1}}, "6.1 ms", Level.BAD),
        ("screen", {"latency_p99_ms": {"screen": 31.0}}, "31.0 ms", Level.OK),
        ("screen", {"latency_p99_ms": {"screen": 51.0}}, "51.0 ms", Level.BAD),
    ],
)
def test_figures_are_judged(cell: str, changes: dict[str, Any], text: str, level: Level) -> None:
    reading = finger_readings(parse_finger_status({**STATUS, **changes}))[cell]
    assert (reading.text, reading.level) == (text, level)


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080)])
@pytest.mark.parametrize("stage", ["train", "calibrate", "run"])
def test_controls_fit(finger: FingerWindow, size: tuple[int, int], stage: str) -> None:
    window, tab = finger.window, finger.tab
    window.resize(*size)
    tab.setup.choose_stage(stage)
    prompt = {"id": 3, "text": "Lay plate B under the finger, then confirm.", "texture": "B"}
    finger.update(run={**RUNNING, "state": "prompt", "prompt": prompt})
    QTest.qWait(50)
    assert (window.width(), window.height()) == size
    area = tab.panel.parentWidget().parentWidget()
    assert isinstance(area, QScrollArea)
    assert tab.panel.minimumSizeHint().width() <= area.viewport().width()
    for text in tab.view.findChildren(QLabel):
        if text.isVisible() and not text.wordWrap() and text.objectName() == "":
            assert text.width() >= text.fontMetrics().horizontalAdvance(text.text()), text.text()
    window.resize(1280, 800)


def test_a_wide_panel_leaves_the_plots_room_for_their_labels(finger: FingerWindow) -> None:
    window, dock = finger.window, finger.window.docks.docks["finger"]
    before = window.size()
    window.docks.resizeDocks([dock], [500], Qt.Orientation.Horizontal)
    window.resize(1024, 700)
    QTest.qWait(1)
    try:
        assert window.width() == 1024 and finger.tab.view.plots.width() >= 320
    finally:
        window.resize(before)
        window.docks.reset()
