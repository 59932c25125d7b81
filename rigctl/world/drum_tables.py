"""What the virtual drum's controller looks up: commands to events and goals, its waits."""

from __future__ import annotations

from enum import IntEnum

from rigctl.wire.drum_map import SETTINGS_BLOCK, Command
from rigctl.wire.drum_states import Event, State

BOOT_US = 10_000
SELFTEST_LIMIT_US = 500_000
LIFT_US = 700_000
BLIND_LIFT_US = 6_000_000
SAVE_US = 1_000 * (2 * SETTINGS_BLOCK[1] + 4)
"""A byte a tick: the settings, their number and their checksum."""
SLOWEST_SEARCH_MM_S = 1.5

UNSUPERVISED = frozenset(
    {State.BOOT, State.SELFTEST, State.IDLE, State.FAULT_LIFT, State.FAULT_OFF}
)
RESTING = frozenset({State.IDLE, State.ARMED})


class Timer(IntEnum):
    """What the controller waits for besides its inputs."""

    BOOT = 0
    SELFTEST = 1
    HEARTBEAT = 2
    SILENCE = 3
    APPROACH = 4
    LIFT = 5
    BLIND_LIFT = 6
    SAVE = 7


TENDED = frozenset({Timer.SILENCE, Timer.HEARTBEAT})
"""Waits that never end while load cell and computer show that they are there."""

EVENTS = {
    Command.ARM: Event.ARM,
    Command.DISARM: Event.DISARM,
    Command.MOVE: Event.MOVE,
    Command.HOME: Event.MOVE,
    Command.TARE_TURN: Event.MOVE,
    Command.APPROACH: Event.APPROACH,
    Command.RUN: Event.RUN,
    Command.RETRACT: Event.RETRACT,
    Command.STOP: Event.STOP,
    Command.CLEAR: Event.CLEAR,
}
GOALS = {
    Command.ARM: State.ARMED,
    Command.DISARM: State.IDLE,
    Command.MOVE: State.ARMED,
    Command.HOME: State.ARMED,
    Command.TARE_TURN: State.ARMED,
    Command.APPROACH: State.HOLD,
    Command.RUN: State.HOLD,
    Command.RETRACT: State.ARMED,
    Command.CLEAR: State.IDLE,
}
