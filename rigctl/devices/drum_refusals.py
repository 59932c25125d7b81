"""Sentences for what the drum refused: why, and what to do."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.wire.drum.codes import Command, Guard, Status
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import FAULT_TEXT, Fault, State, StateEvent, next_state

REFUSED_IN_STATE = 4
"""Modbus exception of a command or a change that the present state refuses."""

_WIRING = frozenset({"optional_signals", "signal_polarity"})
_NEEDS_LIFT = frozenset(
    {
        Command.TARE,
        Command.TARE_TURN,
        Command.APPROACH,
        Command.APPROACH_SETUP,
        Command.DEFAULTS,
    }
)
_APPROACHES = (Command.APPROACH, Command.APPROACH_SETUP)
_RESTING = (State.IDLE, State.ARMED)
_EVENTS = {
    Command.ARM: StateEvent.ARM,
    Command.DISARM: StateEvent.DISARM,
    Command.MOVE: StateEvent.MOVE,
    Command.HOME: StateEvent.MOVE,
    Command.TARE_TURN: StateEvent.MOVE,
    Command.APPROACH: StateEvent.APPROACH,
    Command.APPROACH_SETUP: StateEvent.APPROACH,
    Command.NUDGE: StateEvent.NUDGE,
    Command.RUN: StateEvent.RUN,
    Command.RETRACT: StateEvent.RETRACT,
    Command.CLEAR: StateEvent.CLEAR,
}
"""The event of the state machine that a command stands for."""


def command_refusal_text(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    """Return which command was refused in which state and, where the status shows it, why."""
    reason = _reason(command, state, fault, status_bits)
    return f"the drum refused {command.name} in state {state.name}" + (reason and f" ({reason})")


def amplifier_text(fault_bits: int, rate_hz: float) -> str:
    """Return why the load cell forbids to arm, with its measured rate, empty where it does not."""
    text = ""
    if fault_bits >> Fault.LOADCELL_RATE & 1:
        text += f": {rate_hz:.3g} samples a second: {FAULT_TEXT[Fault.LOADCELL_RATE]}"
    if fault_bits >> Fault.LOADCELL_NOISE & 1:
        text += f": {FAULT_TEXT[Fault.LOADCELL_NOISE]}"
    return text


def _reason(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    if fault is not Fault.NONE:
        return FAULT_TEXT[fault]
    if state in _RESTING and (reason := _resting_reason(command, state, status_bits)):
        return reason
    if command is Command.RUN and state is State.HOLD:
        return "the run-in is too short for this speed: lower the speed or lengthen the run-in"
    return _state_reason(command, state)


def _resting_reason(command: Command, state: State, status_bits: int) -> str:
    """Return why a command was refused though the drum stands still, lifted or switched off."""
    if command in _NEEDS_LIFT and status_bits >> Status.CONTACT_MAY_STAND & 1:
        return "it may rest on something: arm it or retract, so that it lifts"
    if command in _APPROACHES and state is State.ARMED:
        if command is Command.APPROACH and not status_bits >> Status.COMMISSIONED & 1:
            return "it is not commissioned for these settings: run rigctl setup"
        if not status_bits >> Status.CELL_TRUSTED & 1:
            return (
                "its load cell has felt nothing since it was switched on or tared for another "
                "drum: disarm, press on the load cell with a finger for a second, and let it go"
            )
        tared = status_bits >> Status.TARED & 1
        return "the force is too near a limit" if tared else "the load cell is not tared: tare it"
    if command is Command.TARE:
        return (
            "the reading is far from the last zero: check what weighs on the drum; "
            "for another drum use rigctl calibrate tare --anyway"
        )
    return ""


def _state_reason(command: Command, state: State) -> str:
    """Return in which states a command is possible, where this is none of them."""
    if command in _EVENTS:
        possible = [s for s in State if next_state(s, _EVENTS[command]) is not None]
    elif command in (Command.TARE, Command.TARE_ANYWAY, Command.SAVE, Command.COMMISSION):
        possible = list(_RESTING)
    else:
        return ""
    if state in possible:
        return ""
    where = f"it is possible in {' or '.join(s.name for s in possible)} only"
    return f"{where}: arm the drum first" if possible == [State.ARMED] else where


def settings_refusal_text(names: Iterable[str], code: int) -> str:
    """Return which settings were not set and, where the state refuses them, when they can be."""
    refused = tuple(names)
    text = f"{', '.join(refused)} not set"
    guarded = any(BY_NAME[name].guard is not Guard.NONE for name in refused)
    if code != REFUSED_IN_STATE or not guarded:
        return text
    text += ": lift the drum to ARMED or IDLE and release the emergency stop first"
    if _WIRING.isdisjoint(refused):
        return text
    return f"{text}; one that closes when it is pressed, press instead (arduino/drum/board.h)"
