"""Compiled co-simulation of the bench and the drum's virtual board, one millisecond at a time.

In each millisecond the board runs first, on the bench's state at the end of the previous one, then
the bench with the board's outputs: the same order as for simulated chips.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rigctl import kernels
from rigctl.bench import electrics, load_cell, mechanics, noise
from rigctl.bench.boards.drum_firmware import FLOAT_FIELDS, INTEGER_FIELDS
from rigctl.bench.electrics import (
    CELL_CLOCK_OPEN,
    END_DOWN,
    END_UP,
    end_level,
    terminal_drive,
    wiper_share,
)
from rigctl.bench.load_cell import LAST_COUNTS, NEXT_US, convert
from rigctl.bench.mechanics import (
    FORCE,
    ROD,
    TIME_MS,
    MechanicsArrays,
    step_millisecond,
)
from rigctl.kernels import compiled, inlined, uncounted

FULL_READING = 1023

_HANDLE, _RUN, _POLL, POLL_AT_MS, POLL_EVERY_MS = range(5)
STOP_ON_CHANGE, CONVERSIONS, POLLS, _CONTROL_SIZE = range(5, 9)
"""Indices of ``control``, int64: addresses of the board and its functions, polling times, and the
numbers of results."""

CYCLES_PER_MS, START_STEPS, MM_PER_STEP, ROD_END_MM = range(4)
"""Indices of ``scales``, float64."""

_POTENTIOMETER = INTEGER_FIELDS.index("potentiometer")
_END_UP, _END_DOWN = map(INTEGER_FIELDS.index, ("end_up", "end_down"))
_DUE, _DUE_CYCLE, _DUE_COUNTS, _IN_STEP = (
    INTEGER_FIELDS.index(f"conversion_{name}") for name in ("due", "cycle", "counts", "in_step")
)
_CHANGES, _SEQUENCE = map(INTEGER_FIELDS.index, ("change_count", "sample_sequence"))
_DRIVE, _POSITION = map(FLOAT_FIELDS.index, ("drive", "position"))
_Floats = NDArray[np.float64]
_Integers = NDArray[np.int64]


def new_control(handle: int, addresses: tuple[int, int]) -> _Integers:
    """Return ``control`` for a board, without polling."""
    control = np.zeros(_CONTROL_SIZE, np.int64)
    control[[_HANDLE, _RUN, _POLL]] = handle, *addresses
    control[POLL_AT_MS] = np.iinfo(np.int64).max
    return control


def _emit_call(context: Any, address: Any, handle: Any, argument: Any) -> Any:
    del context, address, handle, argument
    signature = types.void(types.int64, types.int64, types.int64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        del signature
        word, byte = ir.IntType(64), ir.IntType(8)
        kind = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), word])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        board = builder.inttoptr(arguments[1], byte.as_pointer())
        builder.call(function, [board, arguments[2]])
        return context.get_dummy_value()

    return signature, generate


_call_board: Any = intrinsic(_emit_call)
"""``_call_board(address, handle, argument)`` calls a C ``void f(void *board, int64_t argument)``.

The address is an argument, not a constant, so that the compiled caller can be cached on disk.
"""


@inlined
def _set_actuator_pins(
    integers: _Integers, rod_mm: float, time_ms: float, scales: _Floats, e: _Floats
) -> None:
    """Set the board's inputs from the actuator's position."""
    share = wiper_share(e, rod_mm / scales[ROD_END_MM], time_ms)
    integers[_POTENTIOMETER] = int(share * FULL_READING + 0.5)
    integers[_END_UP] = end_level(e, END_UP, rod_mm, scales[ROD_END_MM])
    integers[_END_DOWN] = end_level(e, END_DOWN, rod_mm, scales[ROD_END_MM])


def _source_digest() -> str:
    """Return a digest of the other files that are compiled into the kernel."""
    modules = electrics, mechanics, load_cell, noise, kernels
    texts = (Path(str(module.__file__)).read_bytes() for module in modules)
    return hashlib.sha256(b"".join(texts)).hexdigest()


def _compile_kernel(digest: str) -> Callable[..., Any]:
    """Return the kernel. ``digest`` adds the other files to its cache key."""

    @compiled
    def run(
        plant: MechanicsArrays,
        loadcell: tuple[_Floats, _Floats],
        cell_noise: NDArray[np.float32],
        io: tuple[_Integers, _Floats, NDArray[np.uint16]],
        scales: _Floats,
        e: _Floats,
        control: _Integers,
        results: tuple[_Integers, NDArray[np.uint16], _Integers],
        until_ms: int,
    ) -> None:
        s, c = uncounted(plant[0]), uncounted(plant[1])
        log, force_table = uncounted(plant[2]), uncounted(plant[3])
        cell, cell_constants = uncounted(loadcell[0]), uncounted(loadcell[1])
        integers, floats, poll_words = uncounted(io[0]), uncounted(io[1]), uncounted(io[2])
        conversions, polls = uncounted(results[0]), uncounted(results[1])
        polls_ms, cell_noise = uncounted(results[2]), uncounted(cell_noise)
        scales, e, control = uncounted(scales), uncounted(e), uncounted(control)
        conversion, sample, poll = 0, 0, 0
        changes = integers[_CHANGES] if digest else 0
        while s[TIME_MS] < until_ms:
            end_ms = s[TIME_MS] + 1.0
            _set_actuator_pins(integers, s[ROD], s[TIME_MS], scales, e)
            at_us = cell[NEXT_US]
            if at_us < end_ms * 1000.0:
                integers[_DUE] = convert(
                    cell, cell_constants, log, s[FORCE], cell_noise[conversion]
                )
                conversion += 1
                integers[_DUE_CYCLE] = int(at_us * 1e-3 * scales[CYCLES_PER_MS])
                integers[_IN_STEP] = e[CELL_CLOCK_OPEN] == 0.0
                integers[_DUE_COUNTS] = int(cell[LAST_COUNTS]) if integers[_IN_STEP] else 0
            sequence = integers[_SEQUENCE]
            _call_board(control[_RUN], control[_HANDLE], int(end_ms * scales[CYCLES_PER_MS]))
            if integers[_SEQUENCE] != sequence:
                conversions[sample, 0] = integers[_DUE_CYCLE]
                conversions[sample, 1] = integers[_DUE_COUNTS]
                sample += 1
            travel_mm = (floats[_POSITION] - scales[START_STEPS]) * scales[MM_PER_STEP]
            step_millisecond(s, c, log, force_table, travel_mm, terminal_drive(e, floats[_DRIVE]))
            if end_ms >= control[POLL_AT_MS]:
                _call_board(control[_POLL], control[_HANDLE], 0)
                polls[poll] = poll_words
                polls_ms[poll] = int(end_ms)
                poll += 1
                control[POLL_AT_MS] += control[POLL_EVERY_MS]
            if control[STOP_ON_CHANGE] and integers[_CHANGES] != changes:
                break
        control[CONVERSIONS] = sample
        control[POLLS] = poll

    return run


run = _compile_kernel(_source_digest())
