"""Why a board restarted, in words; both chips keep the same bits (MCUSR)."""

from __future__ import annotations

from rigctl.wire.drum.register_table import ResetCause

_WORDS = (
    (ResetCause.POWER_ON, "power-up"),
    (ResetCause.WATCHDOG, "the watchdog: its program hung"),
    (ResetCause.BROWN_OUT, "a dip of its supply"),
    (ResetCause.EXTERNAL, "its reset pin"),
    (ResetCause.JTAG, "a debugger"),
)
"""The first that applies: power-up sets some of the others as well."""


def reset_words(mcusr: int) -> str:
    """What reset a board, from the bits it kept; its bootloader may have hidden them."""
    for cause, words in _WORDS:
        if mcusr >> cause & 1:
            return words
    return "a cause its bootloader did not tell"


def was_unwanted(mcusr: int) -> bool:
    """Whether the board restarted because something is wrong with it or its supply."""
    wrong = 1 << ResetCause.WATCHDOG | 1 << ResetCause.BROWN_OUT
    return bool(mcusr & wrong) and not mcusr >> ResetCause.POWER_ON & 1
