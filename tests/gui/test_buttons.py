"""Which buttons can be pressed, and what the engine then hears."""

from __future__ import annotations

from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from gui.operate.operate_panel import ACTIONS
from rigctl.wire.drum.states import State, StateEvent, next_state
from tests.gui.steps import Bench, click

OFFERED = {
    State.IDLE: {"arm", "tare"},
    State.ARMED: {"disarm", "tare", "home", "approach", "retract"},
    State.APPROACH: {"retract"},
    State.HOLD: {"run", "retract"},
    State.RUN: {"retract"},
    State.RETRACT: set(),
    State.FAULT_LIFT: set(),
    State.FAULT_OFF: {"clear_fault"},
}


OF_THE_TAXELS = {"calibrate_range", "test_taxels"}


def _enabled(bench: Bench) -> set[str]:
    buttons = bench.window.operate_panel.buttons
    return {name for name, button in buttons.items() if button.isEnabled()}


@pytest.mark.parametrize("state", OFFERED)
def test_only_what_the_board_would_take_can_be_pressed(bench: Bench, state: State) -> None:
    bench.see(state=int(state))
    assert _enabled(bench) == OFFERED[state] | OF_THE_TAXELS
    for action in ACTIONS:
        if action.command in OFFERED[state] and action.command not in ("tare", "home"):
            assert next_state(state, StateEvent[action.event.name]) is not None


@pytest.mark.parametrize("state", OFFERED)
def test_each_button_sends_its_command(bench: Bench, state: State) -> None:
    bench.see(state=int(state))
    for name in OFFERED[state]:
        click(bench.window.operate_panel.buttons[name])
        assert bench.engine.commands[-1] == name


def test_hands_off_while_a_protocol_runs(bench: Bench) -> None:
    bench.see(state=int(State.HOLD), run={"state": "running"})
    assert _enabled(bench) == {"calibrate_range"}
    assert not bench.window.operate_panel.set_button.isEnabled()
    assert bench.window.toolbar.stop_button.isEnabled()


def test_nothing_can_be_asked_of_an_unplugged_drum(bench: Bench) -> None:
    bench.see(drum_connected=False, state=int(State.IDLE))
    assert _enabled(bench) == OF_THE_TAXELS


def test_the_taxels_are_tested_by_a_button(bench: Bench) -> None:
    bench.see()
    click(bench.window.operate_panel.buttons["test_taxels"])
    assert bench.engine.commands[-1] == "test_taxels"


def test_set_points_go_out_with_their_units(bench: Bench) -> None:
    bench.see()
    operate = bench.window.operate_panel
    operate.speed.setValue(120.0)
    operate.force.setValue(1000.0)
    click(operate.set_button)
    assert bench.engine.asked[-1] == ("set", {"speed_mm_s": 120.0, "force_g": 1000.0})


def test_set_points_keep_to_the_boards_range(bench: Bench) -> None:
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
def test_jog_is_offered_when_the_drum_would_take_it_else_says_why(
    bench: Bench, status: dict[str, Any], reason: str
) -> None:
    bench.see(**status)
    for button in bench.window.operate_panel.jog.buttons.values():
        assert button.isEnabled() is not bool(reason)
        assert (reason or "mm of texture") in button.toolTip()


def test_jog_asks_once_and_keeps_the_keyboards_focus(bench: Bench) -> None:
    bench.see(state=int(State.ARMED))
    jog = bench.window.operate_panel.jog
    bench.engine.answers = False
    bench.window.activateWindow()
    jog.buttons[-10].setFocus()
    for _ in range(2):
        focused = bench.window.focusWidget()
        assert focused is not None
        QTest.keyClick(focused, Qt.Key.Key_Space)
    assert bench.engine.asked == [("jog", {"mm": -10.0})]
    bench.window.operate_panel.jog.finish()
    assert jog.buttons[-10].hasFocus()


def test_a_refused_jog_is_offered_again(bench: Bench) -> None:
    bench.engine.refusals["jog"] = "the drum is 'pressing down'"
    bench.see(state=int(State.ARMED))
    click(bench.window.operate_panel.jog.buttons[1])
    bench.window.poll()
    assert bench.window.operate_panel.jog.buttons[1].isEnabled()
    assert "jog: the drum is 'pressing down'" in bench.window.event_log.toPlainText()


def test_a_refusal_is_said_in_log_and_status_line(bench: Bench) -> None:
    bench.engine.refusals["arm"] = "the emergency stop is pressed: release it, then arm"
    bench.see(state=int(State.IDLE))
    click(bench.window.operate_panel.buttons["arm"])
    bench.window.poll()
    assert "release it, then arm" in bench.window.status_line.text()
    assert "release it, then arm" in bench.window.event_log.toPlainText()


def test_a_fault_is_said_in_words(bench: Bench) -> None:
    words = "force above the limit: check the sensor and the plate, then clear the fault"
    bench.see(state=int(State.FAULT_OFF), fault=2, fault_words=words)
    assert bench.window.operate_panel.fault.text() == words
    assert bench.window.toolbar.state_words.text() == words
    assert bench.window.toolbar.state.text() == "FAULT OFF"


def test_faults_are_offered_on_a_simulated_bench_only(bench: Bench) -> None:
    bench.see(simulated=True)
    assert bench.window.operate_panel.bench.inject.isVisibleTo(bench.window)
    bench.see(simulated=False)
    assert not bench.window.operate_panel.bench.inject.isVisibleTo(bench.window)
