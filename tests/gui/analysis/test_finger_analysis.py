"""The Analysis tab opens sessions of the moving finger and draws Figures 4B, 4C and S5."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.analysis.accuracy import AccuracyPage
from gui.analysis.results_view import FigureView
from gui.analysis.run_box import REALTIME
from rigctl.finger.values import Stage
from tests.finger.analysis.made_sessions import write_session
from tests.finger.analysis.test_recorded_scans import FIRST, NEW
from tests.finger.harness import ONE_SCAN, open_finger_harness
from tests.gui.steps import Harness, click, wait_until


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session of two scans of the virtual finger."""
    with open_finger_harness(tmp_path_factory.mktemp("finger")) as harness:
        harness.record(harness.request(protocol=ONE_SCAN))
        return harness.session


def _open(harness: Harness, session: Path) -> None:
    harness.window.show_panel("analysis")
    tab = harness.window.analysis_tab
    tab.panel.folder.setText(str(session))
    click(tab.panel.open_button)
    wait_until(lambda: tab.panel.model.rowCount() > 0 and not tab.reader.is_busy, 30_000)


def test_a_scan_is_shown_as_a_picture(harness: Harness, recorded: Path) -> None:
    _open(harness, recorded)
    tab = harness.window.analysis_tab
    assert "moving finger, normalise; 2 of 2 scans committed, simulated" in tab.panel.about.text()
    wait_until(lambda: tab.figure_view.is_shown, 30_000)
    assert harness.window.stack.currentWidget() is tab.figure_view
    assert tab.panel.run_box.method.currentData() == REALTIME
    assert tab.panel.run_box.method.count() == 1, "the drum's methods do not fit"
    replay, button = harness.window.replay, tab.panel.trials.replay_button
    assert not button.isEnabled() and "no replay" in button.toolTip()
    QTest.keyClick(tab.panel.table, Qt.Key.Key_Return)
    assert not replay.is_shown


def test_the_experiment_is_analysed_with_its_later_sessions(
    harness: Harness, tmp_path: Path
) -> None:
    training = write_session(tmp_path / "train", FIRST)
    later = [
        write_session(tmp_path / stage, [one for one in NEW if one.stage is stage])
        for stage in (Stage.CALIBRATE, Stage.RUN)
    ]
    _open(harness, training)
    tab = harness.window.analysis_tab
    run_box = tab.panel.run_box
    assert run_box.form.fields["iterations"].value() == 100
    run_box.form.fields["iterations"].setValue(2)
    for session in later:
        run_box.form.add_session(str(session))
    click(run_box.run_button)
    wait_until(lambda: "The report is" in run_box.result.text(), 120_000)
    view = tab.results_view
    wait_until(lambda: view.is_whole)
    names = [view.tabText(i) for i in range(view.count())]
    assert names[:3] == ["Figure 4B", "Figure 4C", "Figure S5"]
    first = view.widget(0)
    assert isinstance(first, AccuracyPage)
    QTest.keyClick(first.plots.graphics, Qt.Key.Key_Right)
    words = first.readout.label.text()
    assert "Same session: Original, components 1:" in words and "the paper: about 65 %" in words
    profiles = view.results.pages[names.index("Profiles")]
    assert "Speed Scaled,slow," in profiles.csv and Path(profiles.figure).exists()
    evidence = view.widget(names.index("Evidence"))
    assert isinstance(evidence, AccuracyPage)
    assert evidence.task.findText("By way") > 0
    assert "way over the plate (mm)" in view.results.pages[names.index("Evidence")].csv
    latencies = view.widget(names.index("Latencies"))
    assert isinstance(latencies, FigureView) and latencies.drawing.isValid()
    assert (tmp_path / "train-report-1" / "report.html").is_file()
