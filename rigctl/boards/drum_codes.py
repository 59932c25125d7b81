"""Values and bit numbers of the drum's registers, and the text of a board's reset cause.

The states and faults are in :mod:`rigctl.boards.drum_states`.
"""

from __future__ import annotations

from enum import IntEnum


class Command(IntEnum):
    """Values of register ``command``, executed when ``command_sequence`` changes."""

    NONE = 0
    ARM = 1
    DISARM = 2
    MOVE = 3
    APPROACH = 4
    RUN = 5
    RETRACT = 6
    STOP = 7
    CLEAR = 8
    TARE = 9
    ZERO_STEPS = 10
    HOME = 11
    SAVE = 12
    DEFAULTS = 13
    TUNE = 14
    TARE_TURN = 15
    TARE_ANYWAY = 16
    NUDGE = 17
    COMMISSION = 18
    APPROACH_SETUP = 19


class CommandResult(IntEnum):
    """Values of ``command_result``; valid once ``command_acknowledged`` shows the sequence."""

    NONE = 0
    DONE = 1
    RUNNING = 2
    WRONG_STATE = 3
    FAILED = 4


class ForceMode(IntEnum):
    """Values of register ``force_mode``."""

    HOLD = 0
    LOCK = 1
    POSITION = 2


class Signal(IntEnum):
    """Bit numbers of registers ``optional_signals`` (fitted) and ``signal_polarity`` (inverted)."""

    ESTOP = 0
    INDEX = 1
    END_SWITCHES = 2
    POSITION = 3
    SYNC = 4


class SettingsFrom(IntEnum):
    """Values of register ``settings_from``."""

    DEFAULTS = 0
    SAVED = 1
    DAMAGED = 2


class Status(IntEnum):
    """Bit numbers of register ``status_bits``."""

    SYNC_HIGH = 0
    INDEX_HIGH = 1
    FORCE_SETTLED = 2
    IN_CONTACT = 3
    SPEED_CONSTANT = 4
    ESTOP_CLOSED = 5
    END_UP = 6
    END_DOWN = 7
    HOMED = 8
    TARED = 9
    CONTACT_MAY_STAND = 10
    LIFT_FAILED = 11
    COMMISSIONED = 12
    DIRECTION_KNOWN = 13
    CELL_TRUSTED = 14


class Guard(IntEnum):
    """When a setting may be changed; writing its present value is always harmless.

    RESTING: in IDLE or ARMED, with the emergency stop closed and no known contact; also after a
    boot, when contact is unknown. LIFTED: the same, and known to be lifted.
    """

    NONE = 0
    RESTING = 1
    LIFTED = 2


class ResetCause(IntEnum):
    """Bit numbers of register ``reset_cause`` (MCUSR, ATmega2560 datasheet §12.5.1)."""

    POWER_ON = 0
    EXTERNAL = 1
    BROWN_OUT = 2
    WATCHDOG = 3
    JTAG = 4


_RESET_TEXT = (
    (ResetCause.POWER_ON, "power-up"),
    (ResetCause.WATCHDOG, "the watchdog: its program hung"),
    (ResetCause.BROWN_OUT, "a dip of its supply"),
    (ResetCause.EXTERNAL, "its reset pin"),
    (ResetCause.JTAG, "a debugger"),
)
"""The first that applies is shown: power-up sets some of the others as well."""


def reset_cause_text(mcusr: int) -> str:
    """Return what reset a board, from its MCUSR bits; its bootloader may have cleared them."""
    for cause, text in _RESET_TEXT:
        if mcusr >> cause & 1:
            return text
    return "a cause its bootloader did not report"


def is_abnormal_reset(mcusr: int) -> bool:
    """Return whether a fault of the board or of its supply reset it."""
    faults = 1 << ResetCause.WATCHDOG | 1 << ResetCause.BROWN_OUT
    return bool(mcusr & faults) and not mcusr >> ResetCause.POWER_ON & 1
