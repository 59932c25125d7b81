"""The bench with the drum's virtual board on it, compiled: one millisecond after the other.

In each millisecond the board runs first, on what it saw at the end of the one before, then the
bench with what the board did: the order of the simulated chips.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench import load_cell, mechanics
from rigctl.simulation.bench.load_cell import LAST_COUNTS, NEXT_US, convert
from rigctl.simulation.bench.mechanics import FORCE, ROD, TIME_MS, RodMotion, pass_millisecond
from rigctl.simulation.bench.numba_options import compiled, inlined
from rigctl.simulation.boards import c_call
from rigctl.simulation.boards.c_call import call_board
from rigctl.simulation.boards.drum_firmware import REALS, WORDS

FULL_READING = 1023
END_MM = 0.05
"""Actuator travel left at which an end switch opens."""
CUT_OFF_READING = 0.37 * FULL_READING
"""A potentiometer's wire that is missing drifts somewhere."""

(
    _HANDLE,
    _RUN,
    _POLL,
    POLL_AT_MS,
    POLL_EVERY_MS,
    STOP_ON_CHANGE,
    CONVERSIONS,
    POLLS,
    _CALLS_SIZE,
) = range(9)
"""Places of ``calls``, int64: the board's address and those of its functions; when to poll; what
came of it."""

CYCLES_PER_MS, START_STEPS, MM_PER_STEP, ROD_END_MM, _CLOCK_SIZE = range(5)
"""Places of ``clock``, float64."""

END_ABSENT, END_INVERTED, POSITION_ABSENT, POSITION_INVERTED, _WIRES_SIZE = range(5)
"""Places of ``wires``, bool: how the bench's optional wires are."""

(_POTENTIOMETER, _END_UP, _END_DOWN, _DUE, _DUE_CYCLE, _DUE_COUNTS, _CHANGES, _SEQUENCE) = (
    WORDS.index(name)
    for name in (
        "potentiometer",
        "end_up",
        "end_down",
        "conversion_due",
        "conversion_cycle",
        "conversion_counts",
        "changes",
        "sequence",
    )
)
_DRIVE, _PLACE = REALS.index("drive"), REALS.index("place")
_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]
_Bools = NDArray[np.bool_]


def new_calls(handle: int, addresses: tuple[int, int]) -> _Integers:
    """Return ``calls`` for a board, without polls."""
    calls = np.zeros(_CALLS_SIZE, np.int64)
    calls[[_HANDLE, _RUN, _POLL]] = handle, *addresses
    calls[POLL_AT_MS] = np.iinfo(np.int64).max
    return calls


@inlined
def _show_wires(words: _Integers, rod_mm: float, clock: _Floats, wires: _Bools) -> None:
    """What the board's pins see of the actuator."""
    share = rod_mm / clock[ROD_END_MM]
    reading = (1.0 - share if wires[POSITION_INVERTED] else share) * FULL_READING
    words[_POTENTIOMETER] = int((CUT_OFF_READING if wires[POSITION_ABSENT] else reading) + 0.5)
    up, down = rod_mm < END_MM, rod_mm > clock[ROD_END_MM] - END_MM
    words[_END_UP] = wires[END_ABSENT] or up != wires[END_INVERTED]
    words[_END_DOWN] = wires[END_ABSENT] or down != wires[END_INVERTED]


def _source_digest() -> str:
    """Names the other files of what is compiled in."""
    texts = (Path(str(module.__file__)).read_bytes() for module in (mechanics, load_cell, c_call))
    return hashlib.sha256(b"".join(texts)).hexdigest()


def _kernel(digest: str) -> Callable[..., Any]:
    """The kernel. ``digest`` is in its key on disk, which would not notice the other files."""

    @compiled
    def run(
        s: _Floats,
        c: _Floats,
        log: _Floats,
        footprint: _Floats,
        cell: _Floats,
        given: _Floats,
        noise: NDArray[np.float32],
        words: _Integers,
        reals: _Floats,
        poll_words: NDArray[np.uint16],
        clock: _Floats,
        wires: _Bools,
        calls: _Integers,
        conversions: _Integers,
        polls: NDArray[np.uint16],
        polled_ms: _Integers,
        until_ms: int,
    ) -> None:
        used, taken, polled = 0, 0, 0
        changes = words[_CHANGES] if digest else 0
        while s[TIME_MS] < until_ms:
            end_ms = s[TIME_MS] + 1.0
            _show_wires(words, s[ROD], clock, wires)
            at_us = cell[NEXT_US]
            if at_us < end_ms * 1000.0:
                words[_DUE] = convert(cell, given, log, s[FORCE], noise[used])
                used += 1
                words[_DUE_CYCLE] = int(at_us * 1e-3 * clock[CYCLES_PER_MS])
                words[_DUE_COUNTS] = int(cell[LAST_COUNTS])
            before = words[_SEQUENCE]
            call_board(calls[_RUN], calls[_HANDLE], int(end_ms * clock[CYCLES_PER_MS]))
            if words[_SEQUENCE] != before:
                conversions[taken, 0] = words[_DUE_CYCLE]
                conversions[taken, 1] = words[_DUE_COUNTS]
                taken += 1
            travel_mm = (reals[_PLACE] - clock[START_STEPS]) * clock[MM_PER_STEP]
            motion = RodMotion(end_ms * 1000.0, travel_mm, 0.0)
            pass_millisecond(s, c, log, footprint, motion, reals[_DRIVE])
            if end_ms >= calls[POLL_AT_MS]:
                call_board(calls[_POLL], calls[_HANDLE], 0)
                polls[polled] = poll_words
                polled_ms[polled] = int(end_ms)
                polled += 1
                calls[POLL_AT_MS] += calls[POLL_EVERY_MS]
            if calls[STOP_ON_CHANGE] and words[_CHANGES] != changes:
                break
        calls[CONVERSIONS] = taken
        calls[POLLS] = polled

    return run


run = _kernel(_source_digest())
