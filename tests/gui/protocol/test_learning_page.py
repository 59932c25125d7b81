"""The learning curve on the page of a run follows the trials, says its interval and is saved."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QPointF

from gui.protocol.learning_page import (
    CANCEL,
    COMPUTE,
    COMPUTING,
    NO_CURVE,
    LearningPage,
)
from gui.protocol.protocol_panel import ProtocolPanel
from rigctl.protocol.loader import parse_protocol
from rigctl.session.recorder import Recorder
from tests.analysis.recordings import record
from tests.analysis.test_learning_curve import commit
from tests.gui.protocol.test_protocol_panel import RUN, open_panel
from tests.gui.steps import Harness, click, wait_until
from tests.session import building


@pytest.fixture
def panel(harness: Harness) -> Iterator[ProtocolPanel]:
    panel = open_panel(harness)
    if not panel.shows_page:
        click(panel.page_button)
    panel.page.tabs.setCurrentWidget(panel.page.attempt_view)
    yield panel
    panel.page.learning.worker.cancel()
    panel.page.tabs.setCurrentWidget(panel.page.attempt_view)
    click(panel.page_button)
    panel.page.show_session("")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session of three plates at six conditions, four trials each."""
    return record(tmp_path_factory.mktemp("learning") / "session", "ABD", repeats=4)


def show_run(harness: Harness, session: Path, committed: int) -> None:
    run = {**RUN, "state": "paused", "trials_committed": committed, "session": str(session)}
    harness.update(run=run)


def front(panel: ProtocolPanel) -> LearningPage:
    panel.page.tabs.setCurrentWidget(panel.page.learning)
    return panel.page.learning


def wait_points(harness: Harness, page: LearningPage, count: int) -> None:
    def has_them() -> bool:
        harness.window.poll()
        harness.update()
        return len(page.view.points) == count

    wait_until(has_them, 60_000)


def test_a_curve_says_accuracy_interval_chance_and_that_it_is_simulated(
    harness: Harness, panel: ProtocolPanel, session: Path
) -> None:
    page = front(panel)
    show_run(harness, session, 72)
    wait_points(harness, page, 4)
    text = page.heading.text()
    assert text.startswith("SIMULATED. ") and "95 % interval" in text
    assert "chance 33.3 %; 3 plates, 4 of each at 6 conditions; 72 trials so far." in text
    assert "Wilson interval" in page.remarks.text() and "94 to 98 %" in page.remarks.text()
    assert page.figure.visibleRegion().boundingRect() == page.figure.rect()  # without scrolling
    ticks = page.view.plot.getAxis("bottom")._tickLevels[0]
    assert [text for _, text in ticks] == ["0", "1", "2", "3", "4"]
    box = page.view.plot.getViewBox()
    page.view.graphics.scene().sigMouseMoved.emit(box.mapViewToScene(QPointF(3.1, 50)))
    assert page.view.title.startswith("3 of each: ") and " of 54 right" in page.view.title


def test_a_curve_is_saved_as_picture_and_numbers(
    harness: Harness, panel: ProtocolPanel, session: Path
) -> None:
    page = front(panel)
    show_run(harness, session, 72)
    wait_points(harness, page, 4)
    folder = session.with_name("session-figures")
    for action in page.save_button.formats.actions():
        action.trigger()
    table = folder / "learning-curve-simulated.csv"
    wait_until(lambda: harness.window.poll() or f"saved {table}" in log(harness))
    with table.open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert len(rows) == 5 and rows[0][6] == "accuracy (%)"
    assert [row[0] for row in rows[1:]] == ["1", "2", "3", "4"]
    assert rows[0][-1] == "simulated" and {row[-1] for row in rows[1:]} == {"yes"}
    files = [folder / f"learning-curve-simulated.{suffix}" for suffix in ("png", "svg", "pdf")]
    wait_until(lambda: harness.window.poll() or all(file.exists() for file in files))
    assert all(file.stat().st_size > 1000 for file in files)
    assert "SIMULATED" in files[1].read_text()


def log(harness: Harness) -> str:
    return harness.window.event_log.toPlainText()


def test_too_few_trials_are_said_in_words(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    page = front(panel)
    record(tmp_path / "one", "A", repeats=1)
    show_run(harness, tmp_path / "one", 6)

    def says_it() -> bool:
        harness.update()
        return "two plates are needed to tell them apart; A has 6" in page.heading.text()

    wait_until(says_it, 60_000)
    assert not page.save_button.isEnabled() and not page.view.points


def test_a_curve_grows_with_the_trials(
    harness: Harness, panel: ProtocolPanel, tmp_path: Path
) -> None:
    text = building.PROTOCOL.replace("repeats = 2", "repeats = 3")
    folder, plan = tmp_path / "growing", parse_protocol(text, "growing").plan()
    with Recorder(folder, building.header(plan), text, building.RIG) as recorder:
        recorder.begin_part("start", "A")
        first = 0
        for trial in plan.trials[:11]:
            first = commit(recorder, trial, first)
        page = front(panel)
        show_run(harness, folder, 11)
        wait_until(lambda: harness.update() or "11 trials" in page.heading.text(), 60_000)
        before = page.view.points[-1]
        commit(recorder, plan.trials[11], first)
        show_run(harness, folder, 12)
        wait_until(lambda: harness.update() or "12 trials" in page.heading.text(), 60_000)
        assert (before.tested, page.view.points[-1].tested) == (6, 12)


def test_nothing_is_computed_for_a_tab_that_nobody_sees(
    harness: Harness, panel: ProtocolPanel, session: Path
) -> None:
    show_run(harness, session, 72)
    wait_until(lambda: harness.update() or len(panel.page.attempts.rows) == 72)
    assert not panel.page.learning.worker.is_busy
    page = front(panel)
    assert panel.page.learning.worker.is_busy and page.button.text() == CANCEL
    wait_points(harness, page, 4)


def test_a_computation_can_be_cancelled_and_begun_again(
    harness: Harness, panel: ProtocolPanel, session: Path
) -> None:
    page = front(panel)
    show_run(harness, session, 72)
    wait_until(lambda: harness.update() or panel.page.learning.worker.is_busy)
    assert page.button.text() == CANCEL and page.heading.text() == COMPUTING
    click(page.button)
    assert page.heading.text() == NO_CURVE
    assert not panel.page.learning.worker.is_busy
    assert page.progress.text().startswith("Cancelled") and page.button.text() == COMPUTE
    click(page.button)
    wait_points(harness, page, 4)


def test_a_process_that_dies_leaves_a_sentence(
    harness: Harness, panel: ProtocolPanel, session: Path
) -> None:
    page = front(panel)
    show_run(harness, session, 72)
    link = panel.page.learning
    wait_until(lambda: harness.update() or link.worker._process is not None)
    process = link.worker._process
    assert process is not None
    process.kill()
    wait_until(lambda: harness.update() or "ended unexpectedly" in page.heading.text())
    click(page.button)
    wait_points(harness, page, 4)
