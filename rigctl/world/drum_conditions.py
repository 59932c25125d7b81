"""What each command of the virtual drum needs before it is accepted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from rigctl.wire.drum_map import Command, ForceMode, Signal
from rigctl.wire.drum_states import State, next_state
from rigctl.world.drum_tables import EVENTS, RESTING

if TYPE_CHECKING:
    from rigctl.world.drum_controller import Controller


def accepts(brain: Controller, command: Command, settings: Mapping[str, int]) -> bool:
    """False where the state, or a present cause, refuses the command."""
    event = EVENTS.get(command)
    if event is not None and next_state(brain.state, event) is None:
        return False
    if command in (Command.ARM, Command.CLEAR):
        return not brain.causes
    if command in (Command.TARE, Command.SAVE, Command.DEFAULTS):
        healthy = command is not Command.TARE or not brain.cell.faults()
        return brain.state in RESTING and healthy
    return _moves(brain, command, settings)


def _moves(brain: Controller, command: Command, settings: Mapping[str, int]) -> bool:
    if command is Command.HOME:
        return brain.health.fitted(Signal.INDEX)
    if command is Command.TARE_TURN:
        return brain.turner.homed and not brain.cell.faults()
    if command is Command.TUNE:
        return brain.state is State.HOLD and settings["force_mode"] == ForceMode.HOLD
    if command is Command.APPROACH:
        # A set force too near the limit would end in OVER_FORCE at the first overshoot.
        return 11 * settings["force_set"] <= 10 * settings["over_force"]
    if command is Command.RUN:
        return brain.presser.step_test is None and brain.turner.run_in_suffices(settings)
    return command is not Command.ZERO_STEPS or not brain.turner.motion.moving
