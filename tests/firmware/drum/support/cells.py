"""Bring the chip to each cell of the state × event table, or say why that is impossible."""

from __future__ import annotations

from rigctl.bench.chips.simavr import Input
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_states import State, StateEvent
from tests.firmware.drum.support.checks import enter_from_idle
from tests.firmware.drum.support.chip import DrumChip

COMMANDS = {
    StateEvent.ARM: Command.ARM,
    StateEvent.DISARM: Command.DISARM,
    StateEvent.MOVE: Command.MOVE,
    StateEvent.APPROACH: Command.APPROACH,
    StateEvent.RUN: Command.RUN,
    StateEvent.RETRACT: Command.RETRACT,
    StateEvent.STOP: Command.STOP,
    StateEvent.CLEAR: Command.CLEAR,
    StateEvent.NUDGE: Command.NUDGE,
}
FAULTS = (StateEvent.TIMED_FAULT, StateEvent.OFF_FAULT)
COMPLETIONS = {
    State.BOOT: (StateEvent.BOOTED,),
    State.SELFTEST: (StateEvent.SELFTEST_PASSED, StateEvent.SELFTEST_FAILED),
    State.POSITION: (StateEvent.MOVE_DONE,),
    State.APPROACH: (StateEvent.FORCE_SETTLED,),
    State.RUN: (StateEvent.TRAVEL_DONE,),
    State.RETRACT: (StateEvent.LIFTED,),
    State.FAULT_LIFT: (StateEvent.LIFT_TIME_OVER,),
    State.NUDGE: (StateEvent.NUDGED,),
}
"""Events that the firmware raises itself, each only in the state that it completes."""
ATTENDED = tuple(s for s in State if s not in (State.BOOT, State.SELFTEST))
NORMAL, SILENT = 0, 1


def unreachable(state: State, event: StateEvent) -> str:
    """Return why no bench can reach this cell; empty if one can."""
    if event in COMPLETIONS.get(state, ()):
        return ""
    if event not in COMMANDS and event not in FAULTS:
        return "a completion event occurs only in the state that it completes"
    if state is State.BOOT:
        return "BOOT ends before the first tick and the first received byte"
    if state is State.SELFTEST and event is StateEvent.TIMED_FAULT:
        return "in SELFTEST, a silent load cell is a failed self-test"
    return ""


def to_idle(drum: DrumChip) -> None:
    """Repair the bench and go from any state to IDLE."""
    drum.x.loadcell_mode = NORMAL
    drum.pin(Input.ESTOP, 0)
    drum.poll_for(60)
    while drum.state is State.FAULT_LIFT:
        drum.poll_for(100)
    if drum.state is State.FAULT_OFF:
        assert drum.command(Command.CLEAR) == 0
    elif drum.state is not State.IDLE:
        drum.command(Command.STOP, 5000)
        assert drum.command(Command.DISARM) == 0
    assert drum.state is State.IDLE


def enter(drum: DrumChip, state: State) -> None:
    """Go from any state to ``state``, without the cause of its fault."""
    to_idle(drum)
    if state is State.FAULT_OFF:
        cause(drum, StateEvent.OFF_FAULT)
        drum.pin(Input.ESTOP, 0)
        drum.run(2)
    elif state is State.RETRACT:
        drum.rod_mm = 15.0
        drum.run(60)
        assert drum.command(Command.ARM) == 0
    elif state is State.NUDGE:
        drum.rod_mm = 5.0
        drum.run(60)
        assert drum.command(Command.NUDGE) == 0
    elif state is State.FAULT_LIFT:
        enter_from_idle(drum, State.ARMED)
        cause(drum, StateEvent.TIMED_FAULT)
    elif state is not State.IDLE:
        enter_from_idle(drum, state)
    assert drum.state is state


def cause(drum: DrumChip, event: StateEvent) -> None:
    """Cause an event by a command, a silent load cell, or the emergency stop."""
    drum.beat()
    if event is StateEvent.MOVE:
        drum.set("move_target", drum.get("steps") + 50_000)
    if event in COMMANDS:
        assert drum.command(COMMANDS[event]) == 0
    elif event is StateEvent.TIMED_FAULT:
        drum.x.loadcell_mode = SILENT
        drum.run(46)
    else:
        drum.pin(Input.ESTOP, 1)
        drum.run(2)
