"""A recorded session is opened, looked at and classified without holding up the window."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox

from gui.analysis.options_form import ENGINES, REPRESENTATIONS, TASKS
from gui.widgets.figure_view import FigureView
from rigctl.analysis.classification import sweep_engines
from rigctl.analysis.features import representations
from rigctl.analysis.paper import tasks
from tests.analysis.recordings import record
from tests.gui.steps import Bench, click, wait_until


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four textures, a few dozen trials."""
    return record(tmp_path_factory.mktemp("recorded") / "session", repeats=2)


@pytest.fixture
def opened(bench: Bench, session: Path) -> Bench:
    """The window with that session open."""
    bench.window.tabs.setCurrentIndex(2)
    panel = bench.window.analysis.panel
    panel.box.way.setCurrentIndex(0)
    panel.folder.setText(str(session))
    click(panel.open)
    wait_until(lambda: not bench.window.analysis.worker.is_busy)
    assert bench.window.analysis.trial_view.data is not None
    assert bench.window.analysis.trial_view.data is not None
    return bench


def test_the_trials_and_the_first_ones_spikes_are_shown(opened: Bench) -> None:
    panel, view = opened.window.analysis.panel, opened.window.analysis.trial_view
    assert panel.model.rowCount() == 48
    assert "48 of 48 trials committed, simulated rig" in panel.about.text()
    assert opened.window.centre.currentWidget() is view
    assert view.data is not None and view.data.samples.shape[1] == 18
    assert len(view.data.spike_row) > 100
    assert view.data.title.startswith("Trial 1: plate A")


def test_another_trial_can_be_chosen(opened: Bench) -> None:
    opened.window.analysis.panel.table.selectRow(30)
    view = opened.window.analysis.trial_view
    wait_until(lambda: view.data is not None and view.data.title.startswith("Trial 31"))


def test_classify_shows_a_sentence_and_a_figure(opened: Bench, session: Path) -> None:
    panel = opened.window.analysis.panel
    click(panel.box.run)
    assert not panel.box.run.isEnabled() and panel.box.cancel.isEnabled()
    wait_until(lambda: bool(panel.box.answer.text()), limit_ms=60_000)
    assert "chance" in panel.box.answer.text()
    assert not opened.window.analysis.figure.picture.isNull()
    assert panel.box.run.isEnabled() and not panel.box.cancel.isEnabled()


def test_classify_can_be_cancelled(opened: Bench) -> None:
    panel = opened.window.analysis.panel
    click(panel.box.run)
    click(panel.box.cancel)
    assert panel.box.run.isEnabled() and not opened.window.analysis.worker.is_busy
    assert "cancelled" in opened.window.log.toPlainText()


def test_a_folder_that_is_no_session_is_refused(bench: Bench, tmp_path: Path) -> None:
    bench.window.tabs.setCurrentIndex(2)
    panel = bench.window.analysis.panel
    panel.folder.setText(str(tmp_path))
    click(panel.open)
    wait_until(lambda: str(tmp_path) in bench.window.sentence.text())


def choose(box: QComboBox, text: str) -> None:
    """Pick an entry of a list with the keyboard, as it stands."""
    place = box.findText(text)
    assert place >= 0, text
    QTest.keyClick(box, Qt.Key.Key_Home)
    for _ in range(place):
        QTest.keyClick(box, Qt.Key.Key_Down)
    assert box.currentText() == text


def test_the_papers_analysis_runs_with_the_options_of_the_command_line(
    opened: Bench, session: Path
) -> None:
    box, desk = opened.window.analysis.panel.box, opened.window.analysis
    choose(box.way, "The paper's analysis")
    assert box.run.text() == "Analyse" and box.form.isVisible()
    choose(box.form.task, "Individual textures")
    choose(box.form.model, "Original")
    box.form.draws.setValue(2)
    box.form.components.setValue(6)
    click(box.run)
    assert box.cancel.isEnabled() and not box.form.isEnabled()
    stages: set[str] = set()
    desk.worker.progressed.connect(lambda stage, _: stages.add(stage))
    wait_until(lambda: bool(box.answer.text()), limit_ms=180_000)
    assert "classifying" in stages and "Individual textures: " in box.answer.text()
    report = session.with_name("session-report-1")
    assert (report / "report.html").exists()
    view = desk.findings
    assert opened.window.centre.currentWidget() is view
    names = [view.tabs.tabText(i) for i in range(view.tabs.count())]
    assert names == ["Table 1", "Accuracy", "Confusion", "One taxel", "Remarks"]
    assert "Speed and Force Scaled, texture-blind" in view.text("Table 1")
    assert "98.85 ± 0.16" in view.text("Table 1") and "Simulated." in view.text("Table 1")
    assert "learnt from all 48 trials" in view.text("Remarks")
    bar = view.tabs.tabBar()
    QTest.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(1).center())
    figure = view.tabs.currentWidget()
    assert isinstance(figure, FigureView) and not figure.picture.isNull()

    choose(box.way, "A trained model")
    box.model.setText(str(session.with_name("session-report-1-model.h5")))
    click(box.run)
    wait_until(lambda: "trials told right" in box.answer.text(), limit_ms=60_000)
    assert "of 48 trials told right" in view.text("Answers")
    assert "Rows: true" in view.text("Confusion")
    assert "none lies outside them" in view.text("Remarks")
    opened.window.analysis.panel.table.selectRow(3)
    wait_until(lambda: opened.window.centre.currentWidget() is desk.trial_view)
    click(box.results)
    assert opened.window.centre.currentWidget() is view


def test_a_cancelled_analysis_leaves_nothing(opened: Bench, session: Path) -> None:
    box, desk = opened.window.analysis.panel.box, opened.window.analysis
    choose(box.way, "The paper's analysis")
    before = sorted(path.name for path in session.parent.iterdir())
    click(box.run)
    wait_until(lambda: any("partial" in path.name for path in session.parent.iterdir()))
    click(box.cancel)
    wait_until(lambda: not desk.worker.is_busy)
    assert sorted(path.name for path in session.parent.iterdir()) == before
    assert box.run.isEnabled() and box.form.isEnabled()


def test_what_cannot_be_analysed_is_said(opened: Bench, tmp_path: Path) -> None:
    box, panel = opened.window.analysis.panel.box, opened.window.analysis.panel
    choose(box.way, "A trained model")
    box.model.setText(str(tmp_path / "none.h5"))
    click(box.run)
    wait_until(lambda: "there is no file" in panel.about.text())
    choose(box.way, "The paper's analysis")
    box.form.add_session(str(tmp_path))
    assert box.form.sessions.text() == f"session, {tmp_path.name}"
    click(box.run)
    wait_until(lambda: f"{tmp_path} is not a session" in panel.about.text())
    click(box.form.forget)
    assert len(box.form.chosen) == 1


def test_the_form_knows_what_the_analysis_knows() -> None:
    assert {r.name: r.key for r in representations.REPRESENTATIONS} == REPRESENTATIONS
    assert tuple(key for key in TASKS.values() if key) == tasks.CHOICES
    assert set(ENGINES.values()) == set(sweep_engines.SweepEngine)
