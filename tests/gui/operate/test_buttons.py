"""The buttons that are enabled in each state, and the commands that they send."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.operate.operate_panel import ACTIONS, SPEED_LATER
from rigctl.bench.parameters import Plate, WorldParameters
from rigctl.bench.world_file import SimulatedWorld
from rigctl.boards.drum_states import Fault, State, StateEvent, next_state
from tests.gui.steps import Harness, click, turn_wheel, wait_until

ENABLED = {
    State.IDLE: {"arm", "tare"},
    State.ARMED: {"disarm", "tare", "home", "approach", "retract"},
    State.APPROACH: {"retract"},
    State.HOLD: {"run", "retract"},
    State.RUN: {"retract"},
    State.RETRACT: set(),
    State.FAULT_LIFT: set(),
    State.FAULT_OFF: {"clear_fault"},
}


TAXEL_COMMANDS = {"test_taxels"}


def _enabled(harness: Harness) -> set[str]:
    buttons = harness.window.operate_panel.buttons
    return {name for name, button in buttons.items() if button.isEnabled()}


@pytest.mark.parametrize("state", ENABLED)
def test_only_possible_commands_are_enabled(harness: Harness, state: State) -> None:
    harness.update(state=int(state))
    assert _enabled(harness) == ENABLED[state] | TAXEL_COMMANDS
    for action in ACTIONS:
        if action.command in ENABLED[state] and action.command not in ("tare", "home"):
            assert next_state(state, StateEvent[action.event.name]) is not None


@pytest.mark.parametrize("state", ENABLED)
def test_each_button_sends_its_command(harness: Harness, state: State) -> None:
    harness.update(state=int(state))
    for name in ENABLED[state]:
        click(harness.window.operate_panel.buttons[name])
        assert harness.engine.commands[-1] == name


def test_commands_are_disabled_while_a_protocol_runs(harness: Harness) -> None:
    harness.update(state=int(State.HOLD), run={"state": "running"})
    assert _enabled(harness) == set()
    assert not harness.window.operate_panel.set_button.isEnabled()
    assert harness.window.toolbar.stop_button.isEnabled()


def test_drum_commands_are_disabled_without_a_drum(harness: Harness) -> None:
    harness.update(drum_connected=False, state=int(State.IDLE))
    assert _enabled(harness) == TAXEL_COMMANDS


def test_taxel_test_button_sends_its_command(harness: Harness) -> None:
    harness.update()
    click(harness.window.operate_panel.buttons["test_taxels"])
    assert harness.engine.commands[-1] == "test_taxels"


def test_set_button_sends_speed_and_force(harness: Harness) -> None:
    harness.update()
    operate = harness.window.operate_panel
    operate.speed.setValue(120.0)
    operate.force.setValue(1000.0)
    click(operate.set_button)
    assert harness.engine.requests[-1] == ("set", {"speed_mm_s": 120.0, "force_g": 1000.0})


def test_set_says_when_a_turning_drum_takes_a_speed(harness: Harness) -> None:
    points = harness.window.operate_panel.set_points
    harness.update(state=int(State.RUN), speed_set_mm_s=80.0, force_set_g=500.0)
    assert points.allowed.text() == SPEED_LATER
    points.speed.setValue(80.0)
    points.force.setValue(600.0)
    click(points.set_button)
    assert harness.engine.requests[-1] == ("set", {"force_g": 600.0})
    points.speed.setValue(120.0)
    click(points.set_button)  # the engine refuses it
    assert harness.engine.requests[-1] == ("set", {"speed_mm_s": 120.0, "force_g": 600.0})
    harness.update(state=int(State.HOLD))
    assert points.allowed.text().startswith("Allowed: 20 to 150 mm/s")


def test_set_points_stay_within_the_limits_of_the_rig(harness: Harness) -> None:
    harness.update(limits={"speed_max_mm_s": 90.0, "force_min_g": 120.0})
    operate = harness.window.operate_panel
    operate.speed.setValue(1e6)
    operate.force.setValue(0.0)
    assert (operate.speed.value(), operate.force.value()) == (90.0, 120.0)
    assert operate.set_points.allowed.text() == "Allowed: 20 to 90 mm/s, 120 to 1200 g"


def test_what_the_drum_has_is_beside_what_is_asked(harness: Harness) -> None:
    harness.update(speed_set_mm_s=80.0, force_set_g=500.0)
    points = harness.window.operate_panel.set_points
    points.speed.setValue(80.0)
    points.force.setValue(600.0)
    assert (points.drum_speed.text(), points.drum_force.text()) == ("80.0 mm/s", "≠ 500 g")
    harness.update(run={"state": "running"})
    assert points.drum_force.text() == "500 g", "a run sets what its protocol says"
    harness.update(run={"state": "idle"}, force_set_g=600.0)
    assert points.drum_force.text() == "600 g"


def test_the_plate_is_the_one_of_the_rig_after_every_connection(harness: Harness) -> None:
    plate = harness.window.operate_panel.bench.plate
    harness.update(texture="K")
    assert plate.currentData() == "K"
    assert plate.currentText() == "K – rectangular ridges, half spacing"
    harness.update(texture=None)
    assert plate.currentText() == "" and plate.placeholderText() == "unknown"
    harness.update(texture="felt 2")
    assert plate.currentText() == "felt 2"


def test_plates_have_names_and_pictures_where_they_are_chosen_and_asked_for(
    harness: Harness,
) -> None:
    """They were bare letters, of which nobody knows at the rig which print is which."""
    own = Plate("felt 2", "waves", 2.0, 5.0)
    world = SimulatedWorld(WorldParameters(plates=(own,))).header_fields()
    harness.engine.send_event("ready", "", rig="virtual", world=world)
    harness.update(state=int(State.IDLE), texture="A")
    plate, panel = harness.window.operate_panel.bench.plate, harness.window.prompt_panel
    texts = [plate.itemText(row) for row in range(plate.count())]
    assert texts[:2] == ["A – smooth", "B – circular ridges, 1.2 mm high, every 6.2 mm"]
    assert texts[-1] == "felt 2 – waves, 2 mm high, every 5 mm"
    size = plate.iconSize()
    pictures = [plate.itemIcon(row).pixmap(size).toImage() for row in range(plate.count())]
    assert all(one != other for one, other in pairwise(pictures))
    row = plate.findData("B")
    plate.setCurrentIndex(row)
    plate.activated.emit(row)
    assert harness.engine.requests[-1] == ("plate", {"texture": "B"})
    prompt = {"id": 4, "text": "Mount plate B, then confirm.", "texture": "B"}
    harness.update(run={"state": "prompt", "prompt": prompt})
    assert panel.text.text() == prompt["text"]
    assert panel.plate.words.text() == texts[1] and not panel.plate.picture.pixmap().isNull()
    next_plate = harness.window.protocol_panel.run_rows["Next plate"]
    assert next_plate.text() == f"B now\n{texts[1].partition(' – ')[2]}"
    message = {"id": 5, "text": "Check the sensor.", "texture": None}
    harness.update(run={"state": "prompt", "prompt": message})
    assert panel.isVisible() and not panel.plate.isVisible()
    harness.update(run={"state": "idle", "prompt": None})
    harness.window.engine_link.close()
    assert plate.itemText(plate.findData("B")) == "B – circular ridges"


def test_the_plate_is_locked_while_the_drum_moves_or_presses(harness: Harness) -> None:
    plate = harness.window.operate_panel.bench.plate
    for state in (State.HOLD, State.RUN, State.RETRACT, State.APPROACH):
        harness.update(state=int(state))
        assert not plate.isEnabled() and "Locked: " in plate.toolTip()
    harness.update(state=int(State.IDLE), contact_may_stand=True)
    assert not plate.isEnabled() and "lift the drum first" in plate.toolTip()
    harness.update(state=int(State.IDLE), contact_may_stand=False)
    assert plate.isEnabled()


def test_the_wheel_changes_a_number_only_with_the_focus_and_a_closed_list_never(
    harness: Harness,
) -> None:
    harness.update(state=int(State.IDLE), texture="A")
    operate = harness.window.operate_panel
    for box in (operate.bench.plate, operate.speed, operate.force):
        operate.bench.inject.setFocus()
        before = operate.bench.plate.currentText(), operate.speed.value(), operate.force.value()
        turn_wheel(box)
        after = operate.bench.plate.currentText(), operate.speed.value(), operate.force.value()
        assert after == before and not box.hasFocus()
    assert harness.engine.commands == []
    harness.window.activateWindow()
    for chosen in (operate.bench.fault, harness.window.protocol_panel.protocol):
        chosen.setFocus()
        place = chosen.currentIndex()
        turn_wheel(chosen)
        assert chosen.currentIndex() == place
    operate.speed.setFocus()
    wait_until(operate.speed.hasFocus)
    speed_mm_s = operate.speed.value()
    turn_wheel(operate.speed)
    assert operate.speed.value() == speed_mm_s - 5


def test_tare_waits_until_the_drum_is_lifted(harness: Harness) -> None:
    tare = harness.window.operate_panel.buttons["tare"]
    harness.update(state=int(State.IDLE), contact_may_stand=True)
    assert not tare.isEnabled() and "Arm first" in tare.toolTip()
    harness.update(state=int(State.ARMED), contact_may_stand=False)
    assert tare.isEnabled() and "Arm first" not in tare.toolTip()


def test_run_says_that_approach_comes_first(harness: Harness) -> None:
    run = harness.window.operate_panel.buttons["run"]
    for state in (State.ARMED, State.APPROACH):
        harness.update(state=int(state))
        assert not run.isEnabled() and run.toolTip().startswith("Approach first")
    harness.update(state=int(State.HOLD))
    assert run.isEnabled() and run.toolTip().startswith("Turn the drum")


@pytest.mark.parametrize(
    ("status", "reason"),
    [
        ({"state": int(State.ARMED)}, ""),
        ({"state": int(State.IDLE)}, "arm the drum first"),
        ({"state": int(State.POSITION)}, "the drum is moving"),
        ({"state": int(State.HOLD)}, "retract first"),
        ({"state": int(State.FAULT_OFF)}, "clear the fault first"),
        ({"state": int(State.ARMED), "run": {"state": "paused"}}, "a protocol is running"),
        ({"state": int(State.ARMED), "drum_connected": False}, "no drum is connected"),
    ],
)
def test_jog_is_enabled_when_possible_else_its_tooltip_says_why(
    harness: Harness, status: dict[str, Any], reason: str
) -> None:
    harness.update(**status)
    for button in harness.window.operate_panel.jog.buttons.values():
        assert button.isEnabled() is not bool(reason)
        assert (reason or "mm of texture") in button.toolTip()


def test_jog_is_sent_once_and_keeps_the_keyboard_focus(harness: Harness) -> None:
    harness.update(state=int(State.ARMED))
    jog = harness.window.operate_panel.jog
    harness.engine.replies = False
    harness.window.activateWindow()
    jog.buttons[-10].setFocus()
    for _ in range(2):
        focused = harness.window.focusWidget()
        assert focused is not None
        QTest.keyClick(focused, Qt.Key.Key_Space)
    assert harness.engine.requests == [("jog", {"mm": -10.0})]
    harness.window.operate_panel.jog.finish()
    assert jog.buttons[-10].hasFocus()


def test_refused_jog_is_enabled_again(harness: Harness) -> None:
    harness.engine.refusals["jog"] = "the drum is 'pressing down'"
    harness.update(state=int(State.ARMED))
    click(harness.window.operate_panel.jog.buttons[1])
    harness.window.poll()
    assert harness.window.operate_panel.jog.buttons[1].isEnabled()
    assert "jog: the drum is 'pressing down'" in harness.window.event_log.toPlainText()


def test_refusal_is_shown_in_log_and_status_line(harness: Harness) -> None:
    harness.engine.refusals["arm"] = "the emergency stop is pressed: release it, then arm"
    harness.update(state=int(State.IDLE))
    click(harness.window.operate_panel.buttons["arm"])
    harness.window.poll()
    assert "release it, then arm" in harness.window.status_line.text()
    assert "release it, then arm" in harness.window.event_log.toPlainText()


def test_the_closing_digest_of_a_run_is_a_line_of_the_log(harness: Harness) -> None:
    harness.engine.send_event("run", "every trial is committed", state="done", digest="4f" * 32)
    harness.window.poll()
    assert harness.window.event_log.toPlainText().count("4f" * 32) == 1


def test_fault_is_shown_in_words(harness: Harness) -> None:
    words = "force above the limit: check the sensor and the plate, then clear the fault"
    harness.update(state=int(State.FAULT_OFF), fault=2, fault_words=words)
    assert harness.window.operate_panel.fault.text() == words
    assert harness.window.toolbar.state_words.text() == "over force"
    assert harness.window.toolbar.state.text() == "FAULT OFF"
    harness.update(fault=int(Fault.ESTOP))
    assert harness.window.toolbar.state_words.text() == "emergency stop"


def test_faults_are_offered_only_on_a_simulated_bench(harness: Harness) -> None:
    harness.update(simulated=True)
    assert harness.window.operate_panel.bench.inject.isVisibleTo(harness.window)
    harness.update(simulated=False)
    assert not harness.window.operate_panel.bench.inject.isVisibleTo(harness.window)
