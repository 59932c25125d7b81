"""A protocol is chosen, planned, started and followed, and its prompts are answered."""

from __future__ import annotations

from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication

from gui.protocol.protocol_panel import ProtocolPanel
from gui.widgets.layouts import PanelArea
from rigctl.values import ABOUT
from tests.gui.steps import Harness, click, wait_until

RUN = {
    "state": "running",
    "trial_id": 38,
    "trials_planned": 96,
    "trials_committed": 37,
    "trials_rejected": 2,
    "eta_s": 400.0,
    "current": {"texture": "C", "speed_mm_s": 80.0, "force_g": 500.0, "repeat": 2},
    "session": "/data/quick-20260101",
}


def open_panel(harness: Harness) -> ProtocolPanel:
    harness.window.show_panel("protocol")
    panel = harness.window.protocol_panel
    if panel.protocol.currentText() != "quick":
        panel.protocol.setCurrentIndex(panel.protocol.findText("quick"))
    wait_planned(harness)
    return panel


def wait_planned(harness: Harness) -> None:
    """Wait for the plan of the chosen protocol."""
    wait_until(lambda: not harness.window.protocol_panel.worker.is_busy)


def test_the_quick_protocol_is_offered_with_its_count(harness: Harness) -> None:
    panel = open_panel(harness)
    assert panel.protocol.currentText() == "quick"
    assert int(panel.plan_rows["Trials"].text()) > 0
    assert "MB of " in panel.plan_rows["Disk space"].text()


def test_free_space_follows_the_folder_and_its_recording(harness: Harness, tmp_path: Path) -> None:
    """It was that of the moment and of the folder for which the protocol was planned."""
    panel = open_panel(harness)
    space = panel.plan_rows["Disk space"]
    panel.out.setText("no whole path")
    wait_until(lambda: not space.text().endswith("free"))
    panel.out.setText(str(tmp_path))
    wait_until(lambda: space.text().endswith("B free"))
    before = space.text()
    recording = {"active": True, "folder": str(tmp_path / "run"), "hours_left": 30.0}
    harness.update(recording={**recording, "disk_free_bytes": 123_000_000_000})
    cell = harness.window.health_strip.cells["disk"].value
    assert space.text().endswith(" of 123 GB free") and cell.text() == "123 GB, 30 h"
    assert panel.run_rows["Disk"].text() == "123 GB free, enough for 30 h"
    harness.update(recording={**recording, "folder": "/another/disk"})
    assert space.text() == before
    harness.update(recording={"active": False, "disk_free_bytes": 0, "folder": None})
    assert cell.text() == panel.run_rows["Disk"].text() == "–"
    wait_until(lambda: not panel.worker.is_busy)
    assert space.text().endswith("B free")


def test_start_sends_file_folder_and_seed(harness: Harness, tmp_path: Path) -> None:
    panel = open_panel(harness)
    panel.out.setText(str(tmp_path))
    panel.seed.setValue(7)
    wait_planned(harness)
    harness.update()
    click(panel.buttons["Start"])
    command, args = harness.engine.requests[-1]
    assert command == "start" and args["seed"] == 7 and args["yes"] is False
    assert args["protocol"].endswith("quick.toml")
    assert Path(args["out"]).parent == tmp_path


def test_no_run_starts_while_the_drum_is_moved_by_hand(harness: Harness) -> None:
    panel = open_panel(harness)
    harness.update(is_moved_by_hand=True)
    assert not panel.buttons["Start"].isEnabled() and not panel.continue_button.isEnabled()
    assert "moved by hand" in panel.buttons["Start"].toolTip()
    harness.update(is_moved_by_hand=False)
    assert panel.buttons["Start"].isEnabled() and panel.continue_button.isEnabled()


def test_interrupted_session_continues(harness: Harness, tmp_path: Path) -> None:
    panel = open_panel(harness)
    panel.out.setText(str(tmp_path))
    harness.update(run={"state": "running"})
    assert not panel.continue_button.isEnabled()
    harness.update(run={"state": "idle"})
    click(panel.continue_button)
    browser = harness.window.file_browser
    assert browser.dialog is not None
    assert Path(browser.dialog.directory().path()) == Path(panel.out.text())
    browser.dialog.fileSelected.emit(str(tmp_path))
    browser.dismiss()
    panel.continue_button.clicked.emit()
    assert browser.dialog is not None, "it begins where the last one was chosen"
    assert Path(browser.dialog.directory().path()) == tmp_path.parent
    browser.dismiss()
    people = dict.fromkeys((*ABOUT, "notes"), "")
    arguments = {"resume": str(tmp_path), "yes": False, **people}
    assert harness.engine.requests[-1] == ("start", arguments)


def test_invalid_protocol_does_not_start_and_shows_the_reason(
    harness: Harness, tmp_path: Path
) -> None:
    panel = open_panel(harness)
    bad = tmp_path / "bad.toml"
    bad.write_text('textures = ["A"]\nspeed_mm_s = [80]\n')
    panel.add_protocol(str(bad))
    wait_planned(harness)
    harness.update()
    assert "bad.toml" in panel.problem.text()
    assert not panel.buttons["Start"].isEnabled()


def test_progress_is_that_of_the_engine(harness: Harness) -> None:
    panel = open_panel(harness)
    harness.update(run=RUN)
    assert panel.run_rows["Progress"].text() == "37 of 96 trials, 6 min 40 s left"
    assert panel.run_rows["Trial"].text() == "#38: C, 80 mm/s, 500 g, repeat 2"
    assert panel.run_rows["Session"].text() == "quick-20260101"
    assert panel.bar.value() == 37 and panel.bar.maximum() == 96


def test_buttons_follow_the_run(harness: Harness) -> None:
    panel = open_panel(harness)
    for state, offered in (
        ("idle", {"Start"}),
        ("running", {"Pause", "Abort"}),
        ("paused", {"Resume", "Abort"}),
        ("prompt", {"Abort"}),
        ("done", {"Start"}),
    ):
        harness.update(run={"state": state})
        assert {n for n, b in panel.buttons.items() if b.isEnabled()} == offered


def test_pause_resume_abort_reach_the_engine(harness: Harness) -> None:
    panel = open_panel(harness)
    harness.update(run={**RUN, "state": "running"})
    click(panel.buttons["Pause"])
    harness.update(run={"state": "paused", "reasons": ["operator"]})
    assert panel.state.text() == "Paused, drum lifted (operator)"
    harness.update(run={"state": "paused", "reasons": ["link", "disk"]})
    assert (
        panel.state.text()
        == "Paused, drum lifted (a board is lost, the disk is too full or too slow)"
    )
    harness.update(run={"state": "prompt", "reasons": ["prompt"]})
    assert panel.state.text() == "Waiting for your answer above"
    harness.update(run={"state": "paused", "reasons": ["operator"]})
    click(panel.buttons["Resume"])
    click(panel.buttons["Abort"])
    assert harness.engine.commands == ["pause", "resume", "abort"]


def test_prompt_is_answered_in_the_window(harness: Harness) -> None:
    prompt = {"id": 4, "text": "Mount plate B, then confirm.", "texture": "B"}
    harness.update(run={"state": "prompt", "prompt": prompt})
    assert harness.window.prompt_panel.text.text() == "Mount plate B, then confirm."
    click(harness.window.prompt_panel.confirm)
    assert harness.engine.requests[-1] == ("answer", {"prompt_id": 4, "answer": "ok"})
    harness.update(run={"state": "running", "prompt": None})
    assert harness.window.prompt_panel.isHidden()


def test_prompt_can_abort_the_run(harness: Harness) -> None:
    harness.update(run={"state": "prompt", "prompt": {"id": 5, "text": "?", "texture": None}})
    click(harness.window.prompt_panel.abort)
    assert harness.engine.requests[-1] == ("answer", {"prompt_id": 5, "answer": "abort"})


def test_time_since_the_last_trial_is_shown(harness: Harness) -> None:
    harness.update(run={**RUN, "trial_age_s": 8.2})
    assert harness.window.health_strip.cells["trial"].value.text() == "8 s ago"


def test_trials_of_an_earlier_sitting_are_not_the_last_trial(harness: Harness) -> None:
    harness.update(run={"state": "idle"})
    harness.update(run={**RUN, "trials_committed": 28, "trial_age_s": None})
    harness.update(run={**RUN, "trials_committed": 28, "trial_age_s": None})
    assert harness.window.health_strip.cells["trial"].value.text() == "–"


@pytest.mark.parametrize("text", ["", "   ", "sessions", "./here"])
def test_a_run_needs_a_folder_to_save_in(
    harness: Harness, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    panel = open_panel(harness)
    panel.out.setText(text)
    harness.update()
    click(panel.buttons["Start"])
    assert "start" not in harness.engine.commands
    assert not panel.buttons["Start"].isEnabled()
    assert panel.problem.isVisible() and "Save in" in panel.problem.text()
    panel.out.setText(str(tmp_path))
    assert panel.buttons["Start"].isEnabled() and not panel.problem.isVisible()


def test_a_run_that_begins_is_in_view_on_a_small_screen(harness: Harness) -> None:
    """The panel stayed where Start is, below the fold, and Pause was out of view."""
    window, panel = harness.window, harness.window.protocol_panel
    before = window.size()
    window.show_panel("protocol")
    window.resize(1024, 700)
    try:
        harness.update(run={"state": "idle"})
        area = window.docks.docks["protocol"].findChild(PanelArea)
        area.ensureWidgetVisible(panel.queue.add_button)
        harness.update(run={"state": "running", "session": "/data/s"})
        QApplication.processEvents()
        for name in ("Pause", "Abort"):
            assert not panel.buttons[name].visibleRegion().isEmpty()
    finally:
        window.resize(before)
