"""A window calibrates its virtual rig from the bring-up list to the board, with real clicks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from PySide6.QtWidgets import QApplication, QPushButton

from gui.operate.calibrate import ALL_KNOWN, CalibratePage
from rigctl.boards.drum_states import State
from tests.gui.rig_window import RigWindow, rig_window
from tests.gui.steps import click


@pytest.fixture(scope="module")
def rig(qapp: QApplication, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigWindow]:
    """Yield a window on a rig whose file has limits of its own."""
    folder = tmp_path_factory.mktemp("runtime")
    path = folder / "rig.toml"
    path.write_text('[ports]\nsimulate = "virtual"\n[limits]\nforce_max_g = 900\n')
    with rig_window(qapp, str(path), folder) as opened:
        yield opened


def page_of(rig: RigWindow, part: str) -> CalibratePage:
    rig.window.operate_panel.bring_up.calibrate.click()
    page = rig.window.tools.calibrate_page
    page.show_part(part)
    return page


def press(rig: RigWindow, button: QPushButton) -> None:
    """Click a button as soon as it is enabled."""
    rig.until(button.isEnabled)
    click(button)


def test_the_load_cell_is_calibrated_with_masses(rig: RigWindow) -> None:
    part = page_of(rig, "loadcell").load_cell
    for number, mass_g in enumerate((None, 200.0, 500.0)):
        if mass_g is not None:
            part.mass.setValue(mass_g)
        press(rig, part.measure_button)
        rig.until(lambda number=number: len(rig.status.calibration.masses) == number + 1)
    assert rig.status.calibration.scale_ug_per_count == pytest.approx(2400, rel=0.005)
    assert rig.status.state is State.IDLE
    press(rig, part.save_button)
    rig.until(lambda: bool(rig.status.loadcell_calibrated))
    assert "with 200 g, 500 g" in rig.status.loadcell_calibrated
    assert "loadcell is saved in the board's EEPROM" in rig.log
    box = rig.window.operate_panel.bring_up
    assert box.rows["Load cell"][1].text() == rig.status.loadcell_calibrated


def test_protocols_are_checked_against_the_file_of_the_rig(rig: RigWindow) -> None:
    forces = rig.window.protocol_panel.page.editor.form.rows["forces_g",]
    assert "50 to 900 g" in forces.note.text()
    assert rig.window.tools.calibrate_page.force.force.maximum() == 900


def test_a_stop_ends_the_search_for_gains_and_leaves_the_drum_off(rig: RigWindow) -> None:
    part = page_of(rig, "force").force
    press(rig, part.measure_button)
    rig.until_state(State.APPROACH, State.HOLD)
    click(rig.window.toolbar.stop_button)
    rig.until(lambda: not rig.status.calibration.measuring)
    rig.until_state(State.IDLE)
    assert rig.status.calibration.gains is None and not rig.status.fault


def test_gains_are_found_and_saved(rig: RigWindow) -> None:
    part = page_of(rig, "force").force
    press(rig, part.measure_button)
    rig.until(lambda: rig.status.calibration.gains is not None)
    press(rig, part.save_button)
    rig.until(lambda: "saved in the board's EEPROM" in part.result_label.text())
    assert rig.status.state is State.IDLE


def test_the_turn_of_the_imbalance_is_cancelled(rig: RigWindow) -> None:
    part = page_of(rig, "imbalance").imbalance
    press(rig, part.measure_button)
    rig.until_state(State.POSITION)
    press(rig, part.cancel_button)
    rig.until(lambda: "the calibration was cancelled" in part.state.text())
    assert rig.status.state is State.IDLE and not rig.status.calibration.imbalance_g


def test_all_taxels_are_identified_after_one_press_was_repeated(rig: RigWindow) -> None:
    part = page_of(rig, "wiring").wiring
    for step in range(12):
        press(rig, part.measure_button)
        rig.until(lambda step=step: rig.status.calibration.wiring_step == step + 1)
        if step == 4:
            press(rig, part.repeat_button)
            rig.until(lambda: rig.status.calibration.wiring_place == 1)
            press(rig, part.measure_button)
            rig.until(lambda: rig.status.calibration.wiring_step == 5)
    rig.until(lambda: part.task.text() == ALL_KNOWN)
    assert "as drawn; a simulated rig has no rig.toml" in part.result_label.text()
    assert rig.status.has_taxel_order and "Traceback" not in rig.log
