"""The end of a run leads to the analysis of its session."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rigctl.engine.rpc.messages import RunStatus
from tests.analysis.recordings import record
from tests.gui.steps import Harness, click, wait_until


def run_status(state: str, session: Path, trials: int = 0) -> dict[str, Any]:
    """Return the run of a status message."""
    return asdict(RunStatus(state, trials_committed=trials, session=str(session)))


def test_the_session_of_a_run_that_ended_is_a_click_away(harness: Harness, tmp_path: Path) -> None:
    kind = {"travel_mm": 12.0, "speeds": (40,), "forces": (250,)}
    session = record(tmp_path / "today", "AB", **kind)
    strip, tab = harness.window.run_end_strip, harness.window.analysis_tab
    harness.update(run=run_status("done", session))
    assert not strip.isVisible(), "this window did not watch that run"
    harness.update(run=run_status("running", session))
    assert not strip.isVisible()
    harness.update(run=run_status("done", session, 2))
    assert strip.isVisible() and "today has ended with 2 trials" in strip.text.text()
    click(strip.analyse_button)
    wait_until(lambda: tab.panel.model.rowCount() == 2)
    assert not strip.isVisible() and tab.panel.isVisible()
    wait_until(lambda: harness.window.stack.currentWidget() is tab.trial_view)
    harness.update(run=run_status("done", session, 2))
    assert not strip.isVisible(), "once is enough"
    wait_until(lambda: not tab.reader.is_busy)
    tab.panel.show_unopened("No session is open.")


def test_the_offer_is_declined_and_a_new_run_hides_it(harness: Harness, tmp_path: Path) -> None:
    strip = harness.window.run_end_strip
    for button in (True, False):
        harness.update(run=run_status("running", tmp_path))
        harness.update(run=run_status("aborted", tmp_path))
        assert strip.isVisible()
        if button:
            click(strip.close_button)
        else:
            harness.update(run=run_status("running", tmp_path))
        assert not strip.isVisible()
    harness.update(run=asdict(RunStatus()))


def test_one_trial_is_no_plural(harness: Harness, tmp_path: Path) -> None:
    strip = harness.window.run_end_strip
    harness.update(run=run_status("running", tmp_path / "short"))
    harness.update(run=run_status("aborted", tmp_path / "short", 1))
    assert strip.text.text() == "The run short has ended with 1 trial."
    click(strip.close_button)


def test_a_run_that_was_aborted_is_continued_where_it_ended(
    harness: Harness, tmp_path: Path
) -> None:
    strip, panel = harness.window.run_end_strip, harness.window.protocol_panel
    box = panel.run_box
    harness.window.show_panel("protocol")
    harness.update(run=run_status("running", tmp_path / "short"))
    assert not box.continue_button.isVisible()
    run = RunStatus(
        "aborted", trials_planned=32, trials_committed=1, session=str(tmp_path / "short")
    )
    for button in (strip.continue_button, box.continue_button):
        harness.update(run=asdict(run))
        assert strip.text.text() == "The run short has ended with 1 of 32 trials."
        click(button)
        command, args = harness.engine.requests[-1]
        assert command == "start" and args["resume"] == str(tmp_path / "short")
    harness.update(run=asdict(replace(run, state="running")))
    assert not strip.isVisible() and not box.continue_button.isVisible()
    harness.update(run=asdict(replace(run, state="done", trials_committed=32)))
    assert not strip.continue_button.isVisible() and not box.continue_button.isVisible()
    click(strip.close_button)
