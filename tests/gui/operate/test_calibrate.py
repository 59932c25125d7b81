"""The page Calibrate: asked, measured, repeated, cancelled, saved, with an engine of the test."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.operate.calibrate import ALL_KNOWN, EMPTY, MORE, NEXT, REHEARSED, CalibratePage
from rigctl.boards.drum_states import FAULT_TEXT, Fault, State
from rigctl.engine.rpc.messages import parse_status
from tests.gui.fake_engine import STATUS
from tests.gui.steps import Harness, click

MASSES = [[0.0, 80_000.0, 120.0], [200.0, 163_333.0, 118.0], [500.0, 288_333.0, 121.0]]
SCALE: dict[str, Any] = {
    "masses": MASSES,
    "scale_ug_per_count": 2400,
    "nonlinearity_share": 0.0004,
}
PRESS: dict[str, Any] = {
    "wiring_step": 4,
    "wiring_question": "Press row 1, column 2 with a blunt tip of about 3 mm and hold it.",
    "wiring_place": 1,
    "wiring_pressed": [[0, 3]],
}


def page_of(harness: Harness) -> CalibratePage:
    return harness.window.tools.calibrate_page


@pytest.fixture
def page(harness: Harness) -> CalibratePage:
    harness.update(state=int(State.IDLE), calibration={})
    harness.window.tools.show_calibration("loadcell")
    return page_of(harness)


def test_masses_are_asked_for_one_after_another(harness: Harness, page: CalibratePage) -> None:
    part = page.load_cell
    assert part.task.text() == EMPTY and not part.mass.isEnabled()
    click(part.measure_button)
    harness.update(calibration={"masses": MASSES[:1]})
    assert part.task.text().startswith(NEXT) and not part.save_button.isEnabled()
    part.mass.setFocus()
    part.mass.selectAll()
    QTest.keyClicks(part.mass, "500")
    QTest.keyClick(part.mass, Qt.Key.Key_Tab)
    click(part.measure_button)
    sent = harness.engine.requests
    assert [args["mass_g"] for _, args in sent] == [0.0, 500.0]
    harness.update(calibration=SCALE)
    assert part.task.text().startswith(MORE)
    assert part.result_label.text() == "2400 µg a count, nonlinearity 0.04 %"
    assert [stem.name for stem in part.plot.stems] == ["0", "200", "500"]
    click(part.save_button)
    assert harness.engine.requests[-1] == ("save_calibration", {"part": "loadcell"})
    harness.update(calibration=SCALE | {"saved": {"loadcell": "the board's EEPROM"}})
    assert part.result_label.text().endswith("saved in the board's EEPROM")
    assert not part.save_button.isEnabled()


def test_the_ranges_that_a_press_has_shown_are_a_table_that_marks_narrow_ones(
    harness: Harness, page: CalibratePage
) -> None:
    part = page.taxel_range
    page.show_part("range")
    part.force.setValue(300)
    click(part.measure_button)
    assert harness.engine.requests[-1] == ("calibrate_range", {"force_g": 300.0})
    harness.update(calibration={"measuring": "range", "elapsed_s": 12.0, "usual_s": 32.0})
    assert part.state.text() == "Measuring: 12 s of about 32 s" and part.cancel_button.isEnabled()
    found = {"low": [40, 41], "high": [240, 49], "rest": [4, 4]}
    harness.update(calibration={"taxel_range": list(found.values())})
    rows = [[part.table.item(row, column).text() for column in range(5)] for row in range(2)]
    assert rows == [["✓ T1", "40", "240", "200", "4"], ["✗ T2", "41", "49", "8", "4"]]
    titles = [part.table.horizontalHeaderItem(column).text() for column in range(5)]
    assert titles[1:] == [f"{name} (counts)" for name in ("Lowest", "Highest", "Span", "Untouched")]
    assert "T2 (8, untouched 4)" in part.result_label.text()
    assert "see that a plate with ridges is mounted" in part.result_label.text()
    harness.update(calibration={"taxel_range": [[40, 41], [240, 149], [4, 4]]})
    words = "In use until the rig disconnects: 2 ranges, the narrowest that of T2 with 108"
    assert part.result_label.text() == f"{words}; {REHEARSED}"
    assert not part.save_button.isEnabled() and page.unsaved == []


def test_measured_ranges_are_saved_and_say_from_when_they_are(
    harness: Harness, page: CalibratePage
) -> None:
    """They were measured anew each day: nothing but the engine had them."""
    part, row = page.taxel_range, harness.window.operate_panel.bring_up.rows["Taxel range"][1]
    page.show_part("range")
    old, new = ("2026-11-23, a press with 500 g", "2026-11-27, a press with 300 g")
    harness.update(has_taxel_range=True, range_from=old)
    assert part.result_label.text().startswith(f"In use: rig.toml, {old}. Measure again after")
    assert row.text() == old
    found = {"taxel_range": [[40, 41], [240, 149], [4, 4]], "rig_file": "/lab/rig.toml"}
    harness.update(calibration=found)
    assert page.unsaved == ["Range"] and row.text() == "measured, not saved"
    click(part.save_button)
    assert harness.engine.requests[-1] == ("save_calibration", {"part": "range"})
    saved = {"saved": {"range": "/lab/rig.toml"}}
    harness.update(range_from=new, calibration=found | saved)
    assert part.result_label.text().startswith("In use: 2 ranges")
    assert part.result_label.text().endswith("; saved in /lab/rig.toml")
    assert not part.save_button.isEnabled() and page.unsaved == [] and row.text() == new
    harness.update(has_taxel_range=False, range_from="", calibration={})


def test_the_live_reading_says_whether_the_mass_is_at_rest(
    harness: Harness, page: CalibratePage
) -> None:
    reading = {"scale_ug_per_count": 2400, "loadcell_counts": 163_333.0, "loadcell_age_s": 0.05}
    harness.update(**reading, loadcell_sd_counts=120.0, calibration={"masses": MASSES[:1]})
    assert "163\u202f333 counts ± 120 in the last second: at rest" in page.load_cell.live.text()
    harness.update(loadcell_sd_counts=5000.0)
    assert "not at rest (at most ± 2\u202f083 for 500 g)" in page.load_cell.live.text()
    harness.update(loadcell_age_s=3.0)
    assert page.load_cell.live.text() == "The load cell's last reading is 3 s old"
    harness.update(loadcell_age_s=None, loadcell_counts=None)


def test_a_reading_that_does_not_fit_is_named_and_removed(
    harness: Harness, page: CalibratePage
) -> None:
    part = page.load_cell
    problem = "the readings are not proportional to the masses (9.0 % off): check the masses"
    harness.update(calibration={"masses": MASSES, "scale_problem": problem})
    assert part.result_label.text() == problem and not part.save_button.isEnabled()
    assert not part.remove_button.isEnabled()
    part.table.selectRow(2)
    harness.update()
    click(part.remove_button)
    assert harness.engine.requests == [("forget_mass", {"mass_g": 500.0})]


def test_a_measurement_shows_its_seconds_and_is_cancelled(
    harness: Harness, page: CalibratePage
) -> None:
    harness.window.tools.show_calibration("force")
    page.force.force.setValue(400)
    click(page.force.measure_button)
    measuring = {"measuring": "force", "elapsed_s": 7.2, "usual_s": 11.3}
    harness.update(calibration=measuring, is_moved_by_hand=True)
    assert page.force.state.text() == "Measuring: 7 s of about 11 s"
    harness.update(calibration=measuring | {"elapsed_s": 13.4})
    assert page.force.state.text() == "Measuring: 13 s, longer than the usual 11 s"
    harness.update(calibration=measuring | {"usual_s": 0.0})
    assert page.force.state.text() == "Measuring: 7 s"
    assert not page.force.measure_button.isEnabled() and not page.imbalance.save_button.isEnabled()
    click(page.force.cancel_button)
    assert harness.engine.requests == [
        ("calibrate_force", {"force_g": 400.0}),
        ("cancel_calibration", {}),
    ]
    harness.update(calibration={}, is_moved_by_hand=False)
    assert page.force.measure_button.isEnabled() and not page.force.cancel_button.isEnabled()


def test_gains_and_imbalance_have_the_words_of_the_command_line(
    harness: Harness, page: CalibratePage
) -> None:
    table_g = [-0.8 + 0.1 * place for place in range(16)]
    gains = [7.5, 5.3, 652.0, 38.2, 9.5, 4.0, 11.3, 2.5]
    harness.update(calibration={"gains": gains, "imbalance_g": table_g})
    assert page.force.result_label.text() == (
        "proportional gain 7.5 1/s, integral gain 5.3 1/s, stiffness 652 g/mm, delay 38.2 ms; "
        "the actuator makes 11.3 mm/s, rests below 9.5 % duty, begins to move 4 % above, "
        "and held the force within ±2.5 g"
    )
    assert page.imbalance.result_label.text() == "imbalance 0.75 g"
    assert "until it is switched off" in page.imbalance.table.text()
    words = page.imbalance.plot.accessibleDescription().split("; ")
    assert (words[0], words[15]) == ("1: -0.80 g", "16: +0.70 g")
    harness.window.tools.show_calibration("imbalance")
    click(page.imbalance.discard_button)
    click(page.imbalance.measure_button)
    assert harness.engine.commands == ["discard_calibration", "calibrate_imbalance"]


def test_one_taxel_after_another_is_asked_for_on_the_map(
    harness: Harness, page: CalibratePage
) -> None:
    part = page.wiring
    harness.window.tools.show_calibration("wiring")
    harness.update(calibration=PRESS)
    assert part.task.text().startswith("Step 5 of 12. Press row 1, column 2")
    assert part.map.text_of(1) == "Press" and part.map.text_of(2) == "?"
    assert part.map.text_of(0) == "✓\nD4·A0\nD4·A3"
    assert "row 1, column 2: Press" in part.map.accessibleDescription()
    click(part.measure_button)
    harness.window.poll()
    click(part.repeat_button)
    assert harness.engine.commands == ["calibrate_wiring", "repeat_press"]
    flat = {"wiring_step": 1, "wiring_question": "Press the whole sensor flat and hold it."}
    harness.update(calibration=flat)
    assert {part.map.text_of(place) for place in range(9)} == {"Press all"}


def test_an_order_that_is_complete_is_saved_at_a_bench_only(
    harness: Harness, page: CalibratePage
) -> None:
    part, done = page.wiring, {"wiring_step": 12, "wiring": list(range(18))}
    harness.update(calibration=done)
    assert part.task.text() == ALL_KNOWN and not part.measure_button.isEnabled()
    assert part.result_label.text().endswith(REHEARSED) and not part.save_button.isEnabled()
    harness.update(calibration=done | {"rig_file": "/lab/rig.toml"})
    harness.window.tools.show_calibration("wiring")
    click(part.save_button)
    assert harness.engine.requests == [("save_calibration", {"part": "wiring"})]


def test_the_plot_of_the_residuals_can_be_read_without_eyes(
    harness: Harness, page: CalibratePage
) -> None:
    harness.update(calibration=SCALE | {"masses": [*MASSES[:2], [500.0, 290_000.0, 121.0]]})
    words = page.load_cell.plot.accessibleDescription()
    assert words.startswith("0 g: ") and words.count(" g: ") == 3
    assert words.split("; ") == page.load_cell.plot.toolTip().split("\n")


def test_the_empty_reading_is_read_again(harness: Harness, page: CalibratePage) -> None:
    part = page.load_cell
    reading = {"loadcell_counts": 80_000.0, "loadcell_age_s": 0.05, "loadcell_sd_counts": 120.0}
    harness.update(**reading, scale_ug_per_count=2400, calibration=SCALE)
    part.mass.setValue(0)
    click(part.measure_button)
    assert harness.engine.requests == [("calibrate_loadcell", {"mass_g": 0.0})]
    harness.update()
    assert "at rest (at most ± 2\u202f083 for 500 g)" in part.live.text()
    part.mass.setValue(200)
    harness.update(loadcell_age_s=None, loadcell_counts=None)


def test_another_connection_shows_nothing_of_the_one_before(
    harness: Harness, page: CalibratePage
) -> None:
    page.wiring.show_found("row 1, column 1: D4·A0 by 200 counts")
    harness.update(calibration=PRESS)
    assert page.wiring.found.text()
    harness.engine.refusals["calibrate_force"] = "the force did not respond to the step"
    harness.window.tools.show_calibration("force")
    click(page.force.measure_button)
    harness.update()
    assert "did not respond" in page.force.state.text()
    harness.engine.refusals.clear()
    found = PRESS | SCALE | {"rig_file": "/lab/rig.toml", "saved": {"loadcell": "/lab/rig.toml"}}
    harness.update(calibration=found)
    harness.window.engine_link.close()
    assert page.wiring.found.text() == ""
    assert (
        "calibration not saved: Taxel order; it is lost" in harness.window.event_log.toPlainText()
    )
    harness.window.engine_link.wait_closed()
    harness.update()
    page.show_status(parse_status(STATUS))
    assert page.force.state.text() == ""


def test_what_a_fault_made_of_a_measurement_goes_with_the_fault(
    harness: Harness, page: CalibratePage
) -> None:
    sentence = FAULT_TEXT[Fault.NO_CONTACT]
    harness.engine.refusals["calibrate_force"] = sentence
    harness.update()
    harness.window.tools.show_calibration("force")
    click(page.force.measure_button)
    harness.update()
    assert page.force.state.text() == sentence
    harness.update(fault=int(Fault.NO_CONTACT), fault_words=sentence)
    assert "Clear the fault first" in page.force.state.text()
    harness.update(fault=0, fault_words="no fault")
    assert page.force.state.text() == ""
    harness.engine.refusals.clear()


def test_a_refusal_to_save_stands_in_the_part_that_was_saved(
    harness: Harness, page: CalibratePage
) -> None:
    sentence = "/lab/rig.toml cannot be written (Permission denied): make it writable"
    harness.engine.refusals["save_calibration"] = sentence
    harness.update(calibration=SCALE)
    page.load_cell.save_button.click()
    harness.window.tools.show_calibration("wiring")
    harness.update()
    assert page.load_cell.state.text() == sentence and page.wiring.state.text() == ""
    assert page.load_cell.save_button.isEnabled()
    harness.engine.refusals.clear()


def test_a_refusal_stands_where_it_was_asked_for(harness: Harness, page: CalibratePage) -> None:
    harness.update(calibration=PRESS)
    harness.window.tools.show_calibration("wiring")
    sentence = "no taxel of the top layer responded: press harder, with a blunt tip"
    harness.engine.refusals["calibrate_wiring"] = sentence
    click(page.wiring.measure_button)
    harness.update()
    harness.update()
    assert page.wiring.state.text() == sentence and page.load_cell.state.text() == ""
    assert sentence in harness.window.event_log.toPlainText()
    harness.engine.refusals.clear()
    click(page.wiring.measure_button)
    harness.update()
    assert page.wiring.state.text() == ""


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ({"run": {"state": "running"}}, "A protocol is running"),
        ({"fault": 2, "state": int(State.FAULT_OFF)}, "Clear the fault first"),
        ({"is_moved_by_hand": True}, "moves by hand"),
        ({"drum_connected": False}, "Connect to a rig first"),
    ],
)
def test_nothing_is_measured_at_a_wrong_moment(
    harness: Harness, page: CalibratePage, status: dict[str, Any], words: str
) -> None:
    harness.update(**status)
    for part in page.parts.values():
        assert words in part.state.text()
        assert not part.measure_button.isEnabled()
        assert not part.save_button.isEnabled()


def test_bring_up_leads_to_the_page(harness: Harness, page: CalibratePage) -> None:
    box, window = harness.window.operate_panel.bring_up, harness.window
    window.show_panel("operate")
    click(page.close_button)
    assert window.stack.currentWidget() is window.live_page
    click(box.calibrate)
    assert window.stack.currentWidget() is page and page.tabs.currentIndex() == 0
    known = {"tared": True, "homed": True, "has_taxel_range": True, "state": int(State.ARMED)}
    harness.update(**known, loadcell_calibrated="2026-11-23 with 500 g", has_taxel_order=False)
    assert box.next.text() == "Next: Taxel order"
    click(box.next)
    assert page.tabs.tabText(page.tabs.currentIndex()) == "Taxel order"
    harness.update(has_taxel_order=True)
    assert box.next.text() == "All done"


def test_a_window_that_watches_cannot_calibrate(harness: Harness, page: CalibratePage) -> None:
    clients = [{"id": 1, "name": "this window"}, {"id": 2, "name": "another"}]
    harness.engine.send_event("control", "", clients=clients, holder=2, asking=[])
    harness.update(calibration=SCALE)
    assert not page.load_cell.measure_button.isEnabled()
    assert "another has control" in page.load_cell.save_button.toolTip()
    harness.engine.send_event("control", "", clients=clients, holder=1, asking=[])
    harness.window.poll()
    assert not page.load_cell.cancel_button.isEnabled(), "nothing is measured"
    harness.update()
    assert page.load_cell.measure_button.isEnabled()
