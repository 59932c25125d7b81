"""A recorded session is opened, looked at and classified without holding up the window."""

from __future__ import annotations

from pathlib import Path

import pytest

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
    panel.folder.setText(str(session))
    click(panel.open)
    wait_until(lambda: not bench.window.analysis.worker.is_busy)
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
    click(panel.classify)
    assert not panel.classify.isEnabled() and panel.cancel.isEnabled()
    wait_until(lambda: bool(panel.accuracy.text()), limit_ms=60_000)
    assert "chance" in panel.accuracy.text()
    assert not opened.window.analysis.figure.picture.isNull()
    assert panel.classify.isEnabled() and not panel.cancel.isEnabled()


def test_classify_can_be_cancelled(opened: Bench) -> None:
    panel = opened.window.analysis.panel
    click(panel.classify)
    click(panel.cancel)
    assert panel.classify.isEnabled() and not opened.window.analysis.worker.is_busy
    assert "cancelled" in opened.window.log.toPlainText()


def test_a_folder_that_is_no_session_is_refused(bench: Bench, tmp_path: Path) -> None:
    bench.window.tabs.setCurrentIndex(2)
    panel = bench.window.analysis.panel
    panel.folder.setText(str(tmp_path))
    click(panel.open)
    wait_until(lambda: str(tmp_path) in bench.window.sentence.text())
