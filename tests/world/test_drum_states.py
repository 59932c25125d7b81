"""The virtual drum walks the table: every state with every command and every completion."""

from __future__ import annotations

import pytest

from rigctl.wire.drum_map import Command
from rigctl.wire.drum_states import OUTPUTS, Event, Fault, State, next_state
from rigctl.world.drum_controller import Controller
from rigctl.world.virtual import open_virtual

COMMANDS = {
    Command.ARM: Event.ARM,
    Command.DISARM: Event.DISARM,
    Command.MOVE: Event.MOVE,
    Command.APPROACH: Event.APPROACH,
    Command.RUN: Event.RUN,
    Command.RETRACT: Event.RETRACT,
    Command.STOP: Event.STOP,
    Command.CLEAR: Event.CLEAR,
}


def controller_in(state: State) -> Controller:
    """A healthy drum that is in this state at rest."""
    rig = open_virtual(seed=0)
    rig.advance(200_000)
    controller = rig._drum.controller
    controller.state = state
    controller.now_us = rig.time_us
    return controller


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_lead_where_the_table_says(state: State, command: Command) -> None:
    controller = controller_in(state)
    wanted = next_state(state, COMMANDS[command])
    accepted = controller.command(controller.now_us, command, 7)
    assert accepted == (wanted is not None)
    assert controller.state is (state if wanted is None else wanted)
    assert controller.acknowledged == (7 if accepted else 0)


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("fault", [f for f in Fault if f is not Fault.NONE])
def test_faults_lead_where_the_table_says(state: State, fault: Fault) -> None:
    controller = controller_in(state)
    timed = fault in (2, 3, 4, 5, 6, 7, 8, 10, 13)
    controller.raise_fault(fault)
    assert controller.state is next_state(state, Event.TIMED_FAULT if timed else Event.OFF_FAULT)
    assert controller.fault is fault


@pytest.mark.parametrize("state", State)
def test_what_may_not_move_in_a_state_is_held_off(state: State) -> None:
    controller = controller_in(State.IDLE)
    controller.actuator.duty = 0.5
    controller.state = next(s for s in State if s is not state)
    left = controller.state
    controller.state = state
    controller._enter(left)
    if OUTPUTS[state].actuator in ("off", "hold"):
        assert controller.actuator.duty == 0.0
    if OUTPUTS[state].actuator == "lift":
        assert controller.actuator.duty < 0.0


def test_the_first_fault_stays_latched() -> None:
    controller = controller_in(State.HOLD)
    controller.raise_fault(Fault.OVER_FORCE)
    controller.raise_fault(Fault.ESTOP)
    assert controller.fault is Fault.OVER_FORCE
    assert controller.state is State.FAULT_OFF
