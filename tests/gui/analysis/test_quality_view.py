"""The page of a session's quality: all trials are judged, and a growing session is followed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from gui.analysis.open_sessions import OpenSessions
from gui.analysis.quality_view import HINT
from tests.analysis.recordings import record
from tests.gui.steps import Harness, wait_until


@pytest.fixture
def shown(harness: Harness, tmp_path: Path) -> Iterator[Harness]:
    """Yield the window with a session of eight trials."""
    kind = {"repeats": 4, "travel_mm": 24.0, "speeds": (40,), "forces": (250,)}
    session = record(tmp_path / "session", "BD", **kind)
    harness.window.show_panel("analysis")
    tab = harness.window.analysis_tab
    tab.open_session(str(session))
    wait_until(lambda: tab.trial_view.data is not None and not tab.reader.is_busy)
    yield harness
    tab.panel.show_unopened("No session is open.")
    tab.trial_view.show_trial(None)
    tab.trial_view.setCurrentIndex(0)
    harness.window.status_line.clear()


def test_the_page_judges_the_session_a_part_at_a_time(
    shown: Harness,
) -> None:
    pages = shown.window.analysis_tab.trial_view
    view = pages.quality
    assert view.judged is None and view.summary.text() == HINT
    pages.setCurrentWidget(view)
    wait_until(lambda: view.judged is not None and not view.is_behind)
    assert view.judged is not None and view.judged.simulated
    assert "8 attempts: 8 pass, 0 quarantine, 0 repeat, 0 given up." in view.summary.text()
    assert view.summary.text().startswith("SIMULATED data")
    assert view.image.image is not None and view.image.image.shape == (18, 8)
    names = [text for _, text in view.verdicts.getAxis("left")._tickLevels[0]]
    assert names == ["given up", "repeat", "quarantine"]
    names, columns, *_ = pages.values()
    assert names[:2] == ("first attempt", "taxel 1 off equal trials (%)")
    assert columns[0].tolist() == list(range(1, 9)) and pages.file_stem() == "quality-simulated"
    assert view.drift.getAxis("left").labelText == "Lifted (counts)"
    left_px = [plot.getViewBox().sceneBoundingRect().left() for plot in view.plots]
    right_px = [plot.getViewBox().sceneBoundingRect().right() for plot in view.plots]
    assert len(set(left_px)) == len(set(right_px)) == 1, "an attempt is at one place in all plots"


def test_many_attempts_take_several_tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gui.analysis.open_sessions.JUDGED_AT_ONCE", 3)
    kind = {"repeats": 4, "travel_mm": 24.0, "speeds": (40,), "forces": (250,)}
    session, sessions = record(tmp_path / "session", "BD", **kind), OpenSessions()
    left = [sessions.judge(str(session)).left for _ in range(4)]
    assert left == [5, 2, 0, 0]
    sessions.open(str(session))
    assert sessions.judge(str(session)).left == 5, "a session that is opened anew is judged anew"
