"""Trials that begin at the left edge of the live plots, with earlier ones behind them."""

from __future__ import annotations

from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from gui.live.earlier_trials import BIN_S, mean_rate_hz
from gui.live.live_page import TRIALS, WAITS, LivePage
from gui.live.navigation import Navigation
from gui.live.sample_history import TimeWindow
from gui.live.time_plots import NOW, SINCE_START
from gui.widgets.theme import LIGHT
from rigctl.engine.rpc.messages import parse_status
from rigctl.session.session import Session
from tests.analysis.recordings import record
from tests.gui.fake_engine import STATUS, FakeEngine
from tests.gui.steps import Harness, click, wait_until

TRIAL, PAUSE = 3000, 2000


@pytest.fixture
def page(qapp: QApplication, engine: FakeEngine) -> Iterator[LivePage]:
    """Yield a page that aligns trials, before the first one."""
    page = LivePage(LIGHT)
    page.resize(1000, 640)
    page.show()
    arrive(page, engine, PAUSE)
    click(page.bar.buttons[TRIALS])
    QTest.keyClick(page.alignment_strip.align, Qt.Key.Key_Space)
    yield page
    page.hide()
    engine.close()


def arrive(page: LivePage, engine: FakeEngine, n: int, sync: bool = False) -> None:
    """Let samples arrive."""
    engine.write_samples(n, sync=sync)
    page.refresh(engine.live)


def run_trials(page: LivePage, engine: FakeEngine, *plates: str) -> None:
    """Run trials, each with a pause before it; the last one goes on."""
    for number, plate in enumerate(plates):
        status = deepcopy(STATUS)
        status["run"]["current"] = {"texture": plate, "speed_mm_s": 80.0, "force_g": 500.0}
        page.show_status(parse_status(status))
        arrive(page, engine, TRIAL, sync=True)
        if number < len(plates) - 1:
            arrive(page, engine, PAUSE)


def navigation(page: LivePage) -> Navigation:
    return page.plots.navigation


def caption(page: LivePage) -> str:
    return str(page.plots.time_plots.raster_plot.getAxis("bottom").labelText)


def visible_lines(page: LivePage) -> list[int]:
    """Return the number of earlier trials in the plots of force, speed and traces."""
    lines = page.plots._earlier_trials._lines
    return [sum(line.isVisible() for line in of_plot) for of_plot in lines]


def test_without_a_trial_the_plots_scroll_and_the_strip_says_why(page: LivePage) -> None:
    assert page.alignment_strip.sentence.text() == WAITS
    assert caption(page) == NOW
    assert navigation(page).window.right == navigation(page).newest


def test_a_trial_begins_at_the_left(page: LivePage, engine: FakeEngine) -> None:
    run_trials(page, engine, "A", "A")
    window = navigation(page).window
    assert (window.left, window.left_s, window.right_s) == (7000, 0.0, 10.0)
    assert caption(page) == SINCE_START
    arrive(page, engine, 500, sync=True)
    assert navigation(page).window == window


def test_a_trial_longer_than_the_axis_goes_on_scrolling(page: LivePage, engine: FakeEngine) -> None:
    page.plots.set_span(2)
    run_trials(page, engine, "A")
    assert navigation(page).window == TimeWindow(navigation(page).newest, 2000, PAUSE)


def test_samples_that_come_are_drawn_and_the_rest_stays_empty(
    page: LivePage, engine: FakeEngine
) -> None:
    run_trials(page, engine, "A")
    image = page.plots.time_plots.raster
    empty = image._pixels[0, -1]
    arrive(page, engine, TRIAL, sync=True)
    split = (image._head + 1) % image._pixels.shape[1]
    shown = np.roll(image._pixels, -split, axis=1)
    columns = np.flatnonzero((shown != shown[:, -1:]).any(axis=0)) / shown.shape[1]
    assert empty == shown[0, -1]
    assert columns.max() == pytest.approx(0.6, abs=0.01) and columns.min() < 0.01


def test_earlier_trials_of_the_condition_stand_behind(page: LivePage, engine: FakeEngine) -> None:
    run_trials(page, engine, "A", "B", "A", "B", "A")
    assert visible_lines(page) == [2, 2, 2]
    text = page.alignment_strip.sentence.text()
    assert text.startswith("plate A, 80 mm/s, 500 g; faint: 2 earlier; line in")
    page.alignment_strip.count.setFocus()
    page.alignment_strip.count.selectAll()
    QTest.keyClicks(page.alignment_strip.count, "1")
    assert visible_lines(page) == [1, 1, 1]


def test_pause_zoom_and_cursor_work_in_a_trial(page: LivePage, engine: FakeEngine) -> None:
    run_trials(page, engine, "A", "A")
    click(page.bar.pause)
    arrive(page, engine, PAUSE)
    run_trials(page, engine, "B")
    view = page.plots.graphics
    assert (navigation(page).window.left, caption(page)) == (7000, SINCE_START)
    QTest.keyClick(view, Qt.Key.Key_Plus)
    assert navigation(page).span_s == 8.0 and navigation(page).window.origin == 7000
    QTest.keyClick(view, Qt.Key.Key_Left, Qt.KeyboardModifier.ControlModifier)
    assert page.cursor_label.text()
    assert visible_lines(page) == [1, 1, 1]
    click(page.bar.pause)
    page.refresh(engine.live)
    assert navigation(page).window.left == 12_000
    assert visible_lines(page) == [0, 0, 0]


def test_the_mean_rate_counts_the_spikes_of_the_earlier_trials(
    page: LivePage, engine: FakeEngine
) -> None:
    run_trials(page, engine, "A", "A", "A")
    starts, data = page.alignment.starts, page.plots.data
    trials = starts.before(starts.trials[-1], 5, 0)
    at_s, rate_hz = mean_rate_hz(data, trials, navigation(page).window, train=20)
    spikes = [data.history.spikes.between(t.start, t.start + TRIAL)[:, 20].sum() for t in trials]
    assert at_s[-1] == pytest.approx(TRIAL / 1000)
    assert rate_hz[::2].sum() * BIN_S == pytest.approx(np.mean(spikes))


def test_the_menu_switches_and_another_rig_begins_anew(harness: Harness) -> None:
    window, engine = harness
    page = window.live_page
    action = next(a for a in window.findChildren(QAction) if a.text() == "Begin at each t&rial")
    action.trigger()
    engine.write_samples(1000)
    page.refresh(engine.live)
    engine.write_samples(1000, sync=True)
    page.refresh(engine.live)
    assert caption(page) == SINCE_START
    page.plots.clear_history()
    page.plots.draw()
    wait_until(lambda: caption(page) == NOW)
    action.trigger()
    assert not page.alignment_strip.align.isChecked()


def test_a_recorded_session_is_cut_where_it_was(
    page: LivePage, engine: FakeEngine, tmp_path: Path
) -> None:
    with Session.open(record(tmp_path / "session", repeats=1)) as session:
        attempts = [np.ascontiguousarray(session.samples(row)) for row in range(2)]
    for samples in attempts:
        arrive(page, engine, PAUSE)
        engine.write_readings(samples, sync=True)
        page.refresh(engine.live)
    first, second = page.alignment.starts.trials
    assert first.end is not None and first.end - first.start == len(attempts[0])
    assert navigation(page).window.left == second.start
    shown = page.plots.data.history.samples.between(second.start, second.start + len(samples))
    assert np.array_equal(shown, attempts[1])
