"""The Analysis tab opens, shows and classifies a recorded session without blocking the window."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QDesktopServices
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QTextBrowser

from gui.analysis.accuracy import AccuracyPage
from gui.analysis.confusion import ConfusionPage
from gui.analysis.results_view import FigureView, ResultsView
from rigctl.analysis import options, pca_lda, representations, tasks
from rigctl.cli import main
from tests.analysis.recordings import record
from tests.gui.steps import Harness, click, wait_until


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session with four textures and 48 trials."""
    return record(tmp_path_factory.mktemp("recorded") / "session", repeats=2)


@pytest.fixture
def opened(harness: Harness, session: Path) -> Harness:
    """Return the window with that session open."""
    harness.window.show_panel("analysis")
    panel = harness.window.analysis_tab.panel
    panel.run_box.method.setCurrentIndex(0)
    panel.folder.setText(str(session))
    click(panel.open_button)
    wait_until(lambda: not harness.window.analysis_tab.reader.is_busy)
    assert harness.window.analysis_tab.trial_view.data is not None
    return harness


def test_trials_and_spikes_of_first_trial_are_shown(opened: Harness) -> None:
    panel, view = opened.window.analysis_tab.panel, opened.window.analysis_tab.trial_view
    assert panel.model.rowCount() == 48
    assert "48 of 48 trials committed, simulated rig" in panel.about.text()
    assert len(panel.digest.text()) == 64
    assert opened.window.stack.currentWidget() is view
    assert view.data is not None and view.data.overview.low.shape[1] == 18
    assert view.data.overview.spikes.sum() > 100
    plates = next(c for c in panel.model.table.columns if c.name == "Plate")
    assert plates.text(0) == "A" and view.data.title.startswith("Trial 13: plate B")
    assert [index.row() for index in panel.table.selectionModel().selectedRows()] == [12]


def test_another_trial_can_be_chosen(opened: Harness) -> None:
    opened.window.analysis_tab.panel.table.selectRow(30)
    view = opened.window.analysis_tab.trial_view
    wait_until(lambda: view.data is not None and view.data.title.startswith("Trial 31"))


def test_classify_shows_a_sentence_and_a_figure(opened: Harness, session: Path) -> None:
    panel = opened.window.analysis_tab.panel
    click(panel.run_box.run_button)
    assert not panel.run_box.run_button.isEnabled() and panel.run_box.cancel_button.isEnabled()
    wait_until(lambda: bool(panel.run_box.result.text()), timeout_ms=60_000)
    assert "chance" in panel.run_box.result.text()
    view = opened.window.analysis_tab.results_view
    wait_until(lambda: view.is_whole)
    names = [view.tabText(i) for i in range(view.count())]
    assert names == ["Accuracy", "Confusion", "Spikes", "In words"]
    assert isinstance(view.widget(0), AccuracyPage) and isinstance(view.widget(1), ConfusionPage)
    figure = view.widget(2)
    assert isinstance(figure, FigureView) and figure.is_shown
    assert view.results.pages[2].csv.startswith("neuron,spike (s)\nSA 1,")
    assert view.results.simulated and "SIMULATED" in view.results.pages[0].origin.upper()
    assert panel.run_box.run_button.isEnabled() and not panel.run_box.cancel_button.isEnabled()


def test_figures_and_reports_go_where_the_user_says(
    opened: Harness, session: Path, tmp_path: Path
) -> None:
    box = opened.window.analysis_tab.panel.run_box
    box.place.setText(str(tmp_path / "results"))
    click(box.run_button)
    wait_until(lambda: bool(box.result.text()), timeout_ms=60_000)
    assert any((tmp_path / "results" / "session-figures").iterdir())
    assert (
        box.form.options(box.place_of(str(session))).out
        == tmp_path / "results" / "session-report-1"
    )
    box.place.clear()
    assert box.form.options(box.place_of(str(session))).out.parent == session.parent


def test_classify_can_be_cancelled(opened: Harness) -> None:
    panel = opened.window.analysis_tab.panel
    click(panel.run_box.run_button)
    click(panel.run_box.cancel_button)
    assert panel.run_box.run_button.isEnabled() and not opened.window.analysis_tab.worker.is_busy
    assert "cancelled" in opened.window.event_log.toPlainText()


def test_folder_without_session_is_refused(harness: Harness, tmp_path: Path) -> None:
    harness.window.show_panel("analysis")
    panel = harness.window.analysis_tab.panel
    panel.folder.setText(str(tmp_path))
    click(panel.open_button)
    wait_until(lambda: str(tmp_path) in harness.window.status_line.text())


def choose(box: QComboBox, text: str) -> None:
    """Choose an item of a list with the keyboard."""
    place = box.findText(text)
    assert place >= 0, text
    QTest.keyClick(box, Qt.Key.Key_Home)
    for _ in range(place):
        QTest.keyClick(box, Qt.Key.Key_Down)
    assert box.currentText() == text


def page_text(view: ResultsView, name: str) -> str:
    """Return the plain text of a page of results."""
    wait_until(lambda: view.is_whole)
    names = [view.tabText(i) for i in range(view.count())]
    page = view.widget(names.index(name))
    assert isinstance(page, QTextBrowser)
    return page.toPlainText()


def test_paper_analysis_has_options_of_command_line(
    opened: Harness,
    session: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    box, tab = opened.window.analysis_tab.panel.run_box, opened.window.analysis_tab
    choose(box.method, "The paper's analysis")
    assert box.run_button.text() == "Analyse" and box.form.isVisible()
    choose(box.form.fields["task"], "Individual textures")
    choose(box.form.fields["representation"], "Original")
    box.form.fields["iterations"].setValue(2)
    box.form.fields["k_max"].setValue(6)
    click(box.run_button)
    assert box.cancel_button.isEnabled() and not box.form.isEnabled()
    stages: set[str] = set()
    tab.worker.progressed.connect(lambda stage, _: stages.add(stage))
    wait_until(lambda: bool(box.result.text()), timeout_ms=180_000)
    assert "classifying" in stages and "Individual textures: " in box.result.text()
    report = session.with_name("session-report-1")
    assert (report / "report.html").exists()
    view = tab.results_view
    assert opened.window.stack.currentWidget() is tab.results_panel
    wait_until(lambda: view.is_whole)
    names = [view.tabText(i) for i in range(view.count())]
    assert names == ["Table 1", "Accuracy", "Confusion", "One taxel", "Remarks"]
    assert "Speed and Force Scaled, texture-blind" in page_text(view, "Table 1")
    header = tab.results_panel.settings.text()
    assert header.startswith(
        "Sessions: session; draws: 2; seed: 0; tasks: textures; components: up"
    )
    opened_paths: list[str] = []
    monkeypatch.setattr(
        QDesktopServices, "openUrl", lambda url: not opened_paths.append(url.toLocalFile())
    )
    click(tab.results_panel.report_button)
    click(tab.results_panel.folder_button)
    assert opened_paths == [str(report / "report.html"), str(report)]
    assert "98.85 ± 0.16" in page_text(view, "Table 1") and "Simulated." in page_text(
        view, "Table 1"
    )
    assert "trained on all 48 trials" in page_text(view, "Remarks")
    bar = view.tabBar()
    QTest.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(1).center())
    page = view.currentWidget()
    assert isinstance(page, AccuracyPage)
    wait_until(lambda: page.plots.is_whole)
    QTest.keyClick(page.plots.graphics, Qt.Key.Key_End)
    saved = json.loads((report / "results.json").read_text())["tasks"]["textures"]
    mean = 100 * saved["representations"]["original"]["mean"][0]
    assert f"Original, components 1: {mean:.2f}" in page.readout.label.text()
    matrices = view.widget(2)
    assert isinstance(matrices, ConfusionPage)
    confusion = saved["representations"]["original"]["confusion"]
    assert matrices.view.matrix.counts == confusion
    figure = view.widget(3)
    assert isinstance(figure, FigureView) and figure.drawing.isValid()
    assert "derivative 1/s" in view.results.pages[3].csv

    choose(box.method, "A trained model")
    box.model.setText(str(session.with_name("session-report-1-model.h5")))
    click(box.run_button)
    wait_until(lambda: "trained on all 48 trials" in box.result.text(), timeout_ms=60_000)
    assert "says nothing about others" in page_text(view, "Predictions")
    capsys.readouterr()
    assert main(["classify", box.model.text(), str(session)]) == 0
    printed = capsys.readouterr().out
    assert box.result.text() == printed.splitlines()[-1], "the words of the command line"
    assert "trial 1: " in printed and ", the model was trained on it" in printed
    assert "trained on it" in page_text(view, "Predictions")
    assert "trained on 48 of these 48 trials" in page_text(view, "Remarks")
    matrices = view.widget(1)
    assert isinstance(matrices, ConfusionPage)
    assert "say nothing about others" in matrices.words.text()
    assert "no reading is outside them" in page_text(view, "Remarks")
    opened.window.analysis_tab.panel.table.selectRow(3)
    wait_until(lambda: opened.window.stack.currentWidget() is tab.trial_view)
    click(box.results_button)
    assert opened.window.stack.currentWidget() is tab.results_panel
    assert "model: " in tab.results_panel.settings.text()
    assert not tab.results_panel.report_button.isVisible()


def test_cancelled_analysis_leaves_no_files(opened: Harness, session: Path) -> None:
    box, tab = opened.window.analysis_tab.panel.run_box, opened.window.analysis_tab
    choose(box.method, "The paper's analysis")
    before = sorted(path.name for path in session.parent.iterdir())
    click(box.run_button)
    wait_until(lambda: any("partial" in path.name for path in session.parent.iterdir()))
    click(box.cancel_button)
    wait_until(lambda: not tab.worker.is_busy)
    assert sorted(path.name for path in session.parent.iterdir()) == before
    assert box.run_button.isEnabled() and box.form.isEnabled()


def test_failed_analysis_shows_the_reason(opened: Harness, tmp_path: Path) -> None:
    box = opened.window.analysis_tab.panel.run_box
    choose(box.method, "A trained model")
    box.model.setText(str(tmp_path / "none.h5"))
    click(box.run_button)
    wait_until(lambda: "No such file" in box.result.text())
    box.form.add_session(str(tmp_path))
    assert box.form.session_names.text() == f"session, {tmp_path.name}"
    wait_until(lambda: f"{tmp_path} is not a session" in box.result.text())
    assert len(box.form.sessions) == 1


def test_form_offers_all_options_of_the_analysis() -> None:
    offered = {
        name: one.metadata for name, one in options.declared(options.AnalysisOptions).items()
    }
    models = [(r.key, r.name) for r in representations.REPRESENTATIONS]
    assert list(offered["representation"]["offered"][1:]) == models
    assert tuple(key for key, _ in offered["task"]["offered"] if key) == tasks.TASK_NAMES
    assert set(offered["engine"]["choices"]) == set(pca_lda.SweepEngine)
