"""The buttons that are enabled in each state, and the commands that they send."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.operate.operate_panel import ACTIONS
from rigctl.wire.drum.states import State, StateEvent, next_state
from tests.gui.steps import Harness, click

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


TAXEL_COMMANDS = {"calibrate_range", "test_taxels"}


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
    assert _enabled(harness) == {"calibrate_range"}
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


def test_set_points_stay_within_the_register_limits(harness: Harness) -> None:
    operate = harness.window.operate_panel
    operate.speed.setValue(1e6)
    operate.force.setValue(0.0)
    assert (operate.speed.value(), operate.force.value()) == (200.0, 50.0)


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
    assert harness.window.toolbar.state_words.text() == words
    assert harness.window.toolbar.state.text() == "FAULT OFF"


def test_faults_are_offered_only_on_a_simulated_bench(harness: Harness) -> None:
    harness.update(simulated=True)
    assert harness.window.operate_panel.bench.inject.isVisibleTo(harness.window)
    harness.update(simulated=False)
    assert not harness.window.operate_panel.bench.inject.isVisibleTo(harness.window)
