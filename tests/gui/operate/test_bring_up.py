"""Bring-up says what is missing, actions log their results, and hand work is recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import QPoint, QRect
from PySide6.QtWidgets import QApplication

from gui.operate.event_log import action_result
from gui.operate.operate_panel import READY
from gui.widgets.labels import Level
from gui.widgets.layouts import PanelArea
from rigctl.boards.drum_states import State
from tests.gui.fake_engine import STATUS
from tests.gui.steps import Harness, click, own_window


def test_bring_up_leads_from_step_to_step_until_the_drum_can_approach(harness: Harness) -> None:
    box = harness.window.operate_panel.bring_up
    harness.update(state=int(State.IDLE), tared=False, homed=False)
    assert box.missing.text() == "Before approach: arm, tare"
    assert box.rows["Arm"][0].level is Level.WARN and box.rows["Self-test"][0].level is Level.OK
    assert box.rows["Load cell"][1].text() == "nominal scale"
    click(box.next)
    harness.update(state=int(State.ARMED))
    assert box.missing.text() == "Before approach: tare"
    click(box.next)
    harness.update(homed=True)
    click(box.next)
    harness.update(tared=True)
    assert box.missing.text() == READY
    click(box.next)
    assert harness.engine.commands == ["arm", "home", "tare"]
    page = harness.window.tools.calibrate_page
    assert page.isVisible() and page.tabs.tabText(page.tabs.currentIndex()) == "Range"
    click(page.close_button)
    known = {"has_taxel_range": True, "has_taxel_order": True}
    harness.update(**known, loadcell_calibrated="2026-11-23 with 500 g")
    assert box.next.text() == "All done" and not box.next.isEnabled()
    assert box.rows["Load cell"][1].text() == "2026-11-23 with 500 g"


def test_bring_up_is_in_view_first_and_lists_its_steps_on_request(harness: Harness) -> None:
    window, before = harness.window, harness.window.size()
    box, area = window.operate_panel.bring_up, window.docks.docks["operate"].findChild(PanelArea)
    harness.update(state=int(State.IDLE), tared=False)
    window.resize(1024, 700)
    QApplication.processEvents()
    try:
        for widget in (box.missing, box.next, box.calibrate, box.steps):
            place = QRect(widget.mapTo(area, QPoint()), widget.size())
            assert area.rect().contains(place)
        assert not box.list.isVisible()
        click(box.steps)
        assert box.list.isVisible() and box.rows["Arm"][1].text() == "off"
        click(box.steps)
        assert not box.list.isVisible()
    finally:
        window.resize(before)


def test_bring_up_names_findings_and_waits_for_a_fault_or_a_run(harness: Harness) -> None:
    box = harness.window.operate_panel.bring_up
    boards = {**STATUS["boards"], "taxels": {**STATUS["boards"]["taxels"], "self_test": ["a"]}}
    harness.update(boards=boards)
    assert box.rows["Self-test"][1].text() == "1 finding" and box.next.text() == "Next: Self-test"
    harness.update(fault=1, state=int(State.FAULT_OFF))
    assert not box.next.isEnabled()
    harness.update(fault=0, state=int(State.ARMED), run={"state": "running"})
    assert not box.next.isEnabled()


@pytest.mark.parametrize(
    ("command", "result", "text"),
    [
        ("arm", {}, "arm: armed, lifted"),
        ("jog", {"moved_mm": -10.0}, "jog: −10.0 mm"),
        ("set", {"speed_mm_s": 60, "force_g": 500}, "set: the drum has 60.0 mm/s and 500 g"),
        ("test_taxels", {"found": []}, "taxel test: no findings"),
        (
            "calibrate_range",
            {"low": [0, 0]},
            "taxel range: the ranges of 2 taxels are measured",
        ),
        ("plate", {"changed": True, "texture": "B"}, "plate: B is on the drum"),
        (
            "inject",
            {"injected": {"fault": "push", "force_g": 2000.0}},
            "bench: Push with 2 kg",
        ),
        ("inject", {"injected": {"fault": "stall", "board": "drum"}}, "bench: stall drum"),
        ("answer", {}, ""),
        ("jog", {}, ""),
    ],
)
def test_each_action_has_its_result_in_words(
    command: str, result: dict[str, Any], text: str
) -> None:
    assert action_result(command, result) == text


def test_an_action_logs_its_result(harness: Harness) -> None:
    harness.update(state=int(State.IDLE))
    click(harness.window.operate_panel.buttons["arm"])
    harness.window.poll()
    assert "done  arm: armed, lifted" in harness.window.event_log.toPlainText()


def test_hand_work_is_recorded_with_a_note_until_the_button_ends_it(
    harness: Harness, tmp_path: Path
) -> None:
    harness.update()
    box = harness.window.operate_panel.record_box
    for text in ("", "  ", "sessions", "./here"):
        box.folder.setText(text)
        harness.update()
        assert not box.button.isEnabled() and box.state.text().startswith("Save in: ")
    box.folder.setText(str(tmp_path))
    assert box.state.text() == ""
    box.note.setText("a new skin")
    click(box.button)
    ((command, args),) = harness.engine.requests
    assert command == "record" and args["note"] == "a new skin"
    folder = Path(args["out"])
    assert folder.parent == tmp_path and folder.name.startswith("by-hand-")
    recording = {"by_hand": True, "active": True, "folder": str(folder), "samples_on_disk": 4200}
    harness.update(recording=recording)
    assert box.state.text() == f"4 s in {folder.name}" and not box.note.isEnabled()
    assert harness.window.toolbar.recording_lamp.level is Level.OK
    click(box.button)
    assert harness.engine.commands == ["record", "end_record"]
    harness.update(recording={"by_hand": False, "active": False})
    assert box.button.text() == "Record" and box.state.text() == ""


def test_no_recording_by_hand_begins_during_a_run(harness: Harness) -> None:
    harness.update(run={"state": "running"})
    assert not harness.window.operate_panel.record_box.button.isEnabled()


def test_a_new_window_begins_with_the_live_plots(qapp: QApplication) -> None:
    with own_window() as window:
        assert window.stack.currentWidget() is window.live_page


def test_a_board_that_is_not_commissioned_leads_to_the_page_set_up(harness: Harness) -> None:
    window = harness.window
    harness.update(commissioned=False)
    box = window.operate_panel.bring_up
    assert box.missing.text().startswith("Before approach: set up") and "Set up" in box.next.text()
    click(box.next)
    assert window.stack.currentWidget() is window.tools.setup_page
    assert harness.engine.requests[-1][0] == "setup_open"
