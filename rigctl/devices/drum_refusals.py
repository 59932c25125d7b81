"""Why the drum refused, and the cure, in the words of a scientist."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.wire.drum.codes import Command, Guard, Status
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import FAULT_TEXT, Fault, State

STATE_REFUSES = 4
"""Modbus exception of a command or change that the present state refuses."""

_WIRES = frozenset({"optional_signals", "signal_polarity"})
_NEEDS_LIFTED = frozenset({Command.TARE, Command.TARE_TURN, Command.APPROACH, Command.DEFAULTS})
_RESTING = (State.IDLE, State.ARMED)


def refused_command(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    """Return what was refused in which state and, where the board's status shows it, why."""
    why = _why(command, state, fault, status_bits)
    return f"the drum refused {command.name} in state {state.name}{f' ({why})' if why else ''}"


def _why(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    if fault is not Fault.NONE:
        return FAULT_TEXT[fault]
    if state not in _RESTING:
        return ""
    if command in _NEEDS_LIFTED and status_bits >> Status.CONTACT_MAY_STAND & 1:
        return "it may rest on something: arm it or retract, so that it lifts"
    if command is Command.APPROACH and state is State.ARMED:
        tared = status_bits >> Status.TARED & 1
        return "the force is too near a limit" if tared else "the load cell is not tared: tare it"
    if command is Command.TARE:
        return (
            "the reading is far from the last zero: look what weighs on the drum; "
            "another drum is tared by rigctl calibrate tare --anyway"
        )
    return ""


def refused_settings(names: Iterable[str], code: int) -> str:
    """Return which settings were not set and, where it is a matter of state, when they can be."""
    listed = tuple(names)
    text = f"{', '.join(listed)} not set"
    if code != STATE_REFUSES or not any(BY_NAME[name].guard is not Guard.NONE for name in listed):
        return text
    text += ": lift the drum to ARMED or IDLE and release the emergency stop first"
    if _WIRES.isdisjoint(listed):
        return text
    return f"{text}; one that closes when it is pressed, press instead (arduino/drum/board.h)"
