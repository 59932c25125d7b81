"""The buttons that are enabled in each state, and the commands that they send."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.operate.operate_panel import ACTIONS
from rigctl.wire.drum.states import State, StateEvent, next_state
from tests.gui.steps import Bench, click

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


def _enabled(bench: Bench) -> set[str]:
    buttons = bench.window.operate_panel.buttons
    return {name for name, button in buttons.items() if button.isEnabled()}


@pytest.mark.parametrize("state", ENABLED)
def test_only_possible_commands_are_enabled(bench: Bench, state: State) -> None:
    bench.update(state=int(state))
    assert _enabled(bench) == ENABLED[state] | TAXEL_COMMANDS
    for action in ACTIONS:
        if action.command in ENABLED[state] and action.command not in ("tare", "home"):
            assert next_state(state, StateEvent[action.event.name]) is not None


@pytest.mark.parametrize("state", ENABLED)
def test_each_button_sends_its_command(bench: Bench, state: State) -> None:
    bench.update(state=int(state))
    for name in ENABLED[state]:
        click(bench.window.operate_panel.buttons[name])
        assert bench.engine.commands[-1] == name


def test_commands_are_disabled_while_a_protocol_runs(bench: Bench) -> None:
    bench.update(state=int(State.HOLD), run={"state": "running"})
    assert _enabled(bench) == {"calibrate_range"}
    assert not bench.window.operate_panel.set_button.isEnabled()
    assert bench.window.toolbar.stop_button.isEnabled()


def test_drum_commands_are_disabled_without_a_drum(bench: Bench) -> None:
    bench.update(drum_connected=False, state=int(State.IDLE))
    assert _enabled(bench) == TAXEL_COMMANDS


def test_taxel_test_button_sends_its_command(bench: Bench) -> None:
    bench.update()
    click(bench.window.operate_panel.buttons["test_taxels"])
    assert bench.engine.commands[-1] == "test_taxels"


def test_set_button_sends_speed_and_force(bench: Bench) -> None:
    bench.update()
    operate = bench.window.operate_panel
    operate.speed.setValue(120.0)
    operate.force.setValue(1000.0)
    click(operate.set_button)
    assert bench.engine.requests[-1] == ("set", {"speed_mm_s": 120.0, "force_g": 1000.0})


def test_set_points_stay_within_the_register_limits(bench: Bench) -> None:
    operate = bench.window.operate_panel
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
    bench: Bench, status: dict[str, Any], reason: str
) -> None:
    bench.update(**status)
    for button in bench.window.operate_panel.jog.buttons.values():
        assert button.isEnabled() is not bool(reason)
        assert (reason or "mm of texture") in button.toolTip()


def test_jog_is_sent_once_and_keeps_the_keyboard_focus(bench: Bench) -> None:
    bench.update(state=int(State.ARMED))
    jog = bench.window.operate_panel.jog
    bench.engine.replies = False
    bench.window.activateWindow()
    jog.buttons[-10].setFocus()
    for _ in range(2):
        focused = bench.window.focusWidget()
        assert focused is not None
        QTest.keyClick(focused, Qt.Key.Key_Space)
    assert bench.engine.requests == [("jog", {"mm": -10.0})]
    bench.window.operate_panel.jog.finish()
    assert jog.buttons[-10].hasFocus()


def test_refused_jog_is_enabled_again(bench: Bench) -> None:
    bench.engine.refusals["jog"] = "the drum is 'pressing down'"
    bench.update(state=int(State.ARMED))
    click(bench.window.operate_panel.jog.buttons[1])
    bench.window.poll()
    assert bench.window.operate_panel.jog.buttons[1].isEnabled()
    assert "jog: the drum is 'pressing down'" in bench.window.event_log.toPlainText()


def test_refusal_is_shown_in_log_and_status_line(bench: Bench) -> None:
    bench.engine.refusals["arm"] = "the emergency stop is pressed: release it, then arm"
    bench.update(state=int(State.IDLE))
    click(bench.window.operate_panel.buttons["arm"])
    bench.window.poll()
    assert "release it, then arm" in bench.window.status_line.text()
    assert "release it, then arm" in bench.window.event_log.toPlainText()


def test_fault_is_shown_in_words(bench: Bench) -> None:
    words = "force above the limit: check the sensor and the plate, then clear the fault"
    bench.update(state=int(State.FAULT_OFF), fault=2, fault_words=words)
    assert bench.window.operate_panel.fault.text() == words
    assert bench.window.toolbar.state_words.text() == words
    assert bench.window.toolbar.state.text() == "FAULT OFF"


def test_faults_are_offered_only_on_a_simulated_bench(bench: Bench) -> None:
    bench.update(simulated=True)
    assert bench.window.operate_panel.bench.inject.isVisibleTo(bench.window)
    bench.update(simulated=False)
    assert not bench.window.operate_panel.bench.inject.isVisibleTo(bench.window)
