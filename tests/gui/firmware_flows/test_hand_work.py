"""Bring-up, and a run by hand that is recorded, on the firmware."""

from __future__ import annotations

from pathlib import Path

from rigctl.boards.drum_states import State
from rigctl.session.session import Session
from rigctl.session.verify import verify
from tests.gui.rig_window import RigWindow
from tests.gui.steps import click


def test_bring_up_from_connect_to_the_taxel_range(rig: RigWindow) -> None:
    box = rig.window.operate_panel.bring_up
    assert "Before approach: arm, tare" in box.missing.text()
    rig.bring_up()
    plate = rig.window.operate_panel.bench.plate
    rig.until(plate.isEnabled)
    plate.setCurrentIndex(plate.findData("B"))  # a smooth one presses some taxels too little
    plate.activated.emit(plate.currentIndex())
    rig.until(lambda: rig.status.texture == "B")
    rig.until(lambda: box.next.text() == "Next: Taxel range")
    rig.until(box.next.isEnabled)
    click(box.next)
    part = rig.window.tools.calibrate_page.taxel_range
    rig.until(lambda: part.measure_button.isVisible() and part.measure_button.isEnabled())
    click(part.measure_button)
    rig.until(lambda: part.state.text().startswith("Measuring: "))
    rig.until(lambda: box.next.text() == "Next: Load cell")  # leads to the page Calibrate
    words = {name: row[1].text() for name, row in box.rows.items()}
    assert words["Self-test"] == "no findings" and words["Home"] == "homed"
    assert words["Tare"] == "tared" and words["Taxel range"] == "measured, not saved"
    assert part.table.rowCount() == 18 and part.result_label.text().startswith("In use until")
    rig.until_state(State.IDLE)  # a calibration ends with everything off


def test_a_run_by_hand_is_recorded_with_its_note(rig: RigWindow, tmp_path: Path) -> None:
    box = rig.window.operate_panel.record_box
    rig.bring_up()
    box.folder.setText(str(tmp_path))
    box.note.setText("first touch of plate D")
    click(box.button)
    rig.until(lambda: box.button.text() == "End recording")
    rig.press("approach")
    rig.until_state(State.HOLD)
    rig.press("run")
    rig.until_state(State.RUN)
    rig.until(lambda: rig.status.speed_mm_s > 20)
    rig.press("retract")
    rig.until_state(State.ARMED)
    rig.until(box.button.isEnabled)
    click(box.button)
    rig.until(lambda: box.button.text() == "Record")
    (folder,) = tmp_path.iterdir()
    assert verify(folder).problems == []
    with Session.open(folder) as session:
        assert "first touch of plate D" in [event.text for event in session.events]
