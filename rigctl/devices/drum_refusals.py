"""Sentences for what the drum refused: why, and what to do."""

from __future__ import annotations

from collections.abc import Iterable

from rigctl.wire.drum.codes import Command, Guard, Status
from rigctl.wire.drum.register_table import BY_NAME
from rigctl.wire.drum.states import FAULT_TEXT, Fault, State

REFUSED_IN_STATE = 4
"""Modbus exception of a command or a change that the present state refuses."""

_WIRING = frozenset({"optional_signals", "signal_polarity"})
_NEEDS_LIFT = frozenset({Command.TARE, Command.TARE_TURN, Command.APPROACH, Command.DEFAULTS})
_RESTING = (State.IDLE, State.ARMED)


def command_refusal_text(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    """Return which command was refused in which state and, where the status shows it, why."""
    reason = _reason(command, state, fault, status_bits)
    return f"the drum refused {command.name} in state {state.name}" + (reason and f" ({reason})")


def _reason(command: Command, state: State, fault: Fault, status_bits: int) -> str:
    if fault is not Fault.NONE:
        return FAULT_TEXT[fault]
    if state not in _RESTING:
        return ""
    if command in _NEEDS_LIFT and status_bits >> Status.CONTACT_MAY_STAND & 1:
        return "it may rest on something: arm it or retract, so that it lifts"
    if command is Command.APPROACH and state is State.ARMED:
        tared = status_bits >> Status.TARED & 1
        return "the force is too near a limit" if tared else "the load cell is not tared: tare it"
    if command is Command.TARE:
        return (
            "the reading is far from the last zero: check what weighs on the drum; "
            "for another drum use rigctl calibrate tare --anyway"
        )
    return ""


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
