"""The kernel in machine code: a block of 64 neurons at a time goes through all samples.

First the currents of a few samples are made, a few lanes at a time; then all neurons of the block
go through these samples substep by substep (where a scheme resets at the next sample, 32 of them
sample by sample). Spikes are counted in bytes, 32 lanes at a time, and told as counts of stretches
of samples or kept as the bits of trains.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rigctl.encoding.kernel.neuron_step import (
    AT_A_TIME,
    BLOCK,
    JUMP,
    KEEP,
    OWN_SIZE,
    OWN_W,
    RESET_TO,
    TAKE,
    THRESHOLD,
    carried,
    copied,
    currents,
    published_sample,
    substep,
)
from rigctl.encoding.kernel.prefetch import PIECE, ROW, RUN, call_up, found, planned
from rigctl.encoding.kernel.simd import UNIT, full, own, store
from rigctl.encoding.kernel.spike_counters import counted, in_order, no_spikes
from rigctl.encoding.kernel.transpose_bits import WORD, hand_over, keep

Kernel = Callable[..., int]

LANES, LANES_OF_SA = UNIT, BLOCK

# numba's disk cache knows the text of this file only, and what a closure holds: so a kernel holds
# what stands for the other files that it is made of.
_PARTS = ("transpose_bits.py", "prefetch.py", "simd.py", "neuron_step.py", "spike_counters.py")
_FILES = (Path(__file__).with_name(name) for name in _PARTS)
_SOURCES = zlib.crc32(b"".join(file.read_bytes() for file in _FILES))


@cache
def kernel(
    *,
    substeps: int,
    old_v: bool,
    coupled: bool,
    late: bool,
    signed: bool,
    sa_only: bool,
    traced: bool,
    trains: bool,
) -> Kernel:
    """Compile one scheme; see :func:`rigctl.encoding.kernel.constants.kernel_for` for its call.

    The arguments are constants of the compiled code, not tests at run time. numba keeps closures
    over plain numbers in its disk cache.
    """
    wide, made_of = LANES_OF_SA if sa_only else LANES, _SOURCES
    groups = wide // RUN

    def advance(
        addresses: Any, lengths: Any, row_bytes: Any, low: Any, width: Any, scale: Any,
        sa_drive: Any, ra_drive: Any, k: Any, state: Any, ends: Any, out: Any, trace: Any,
    ) -> int:  # fmt: skip
        _ = made_of
        lanes, rows, most = low.shape[0], ends.shape[0], 0
        of_lanes, ways = (low, width, scale, sa_drive, ra_drive), (late, signed, sa_only)
        reset = (full(k[THRESHOLD], 1), full(k[RESET_TO], 1), full(k[JUMP], 1))
        c = (full(k[TAKE], 1), full(k[KEEP], 1), *reset)
        block = own("float64", OWN_SIZE)
        n_pieces, pieces = np.empty(groups, np.int64), np.empty((groups, RUN, PIECE), np.int64)
        copies = np.zeros(AT_A_TIME * ROW, np.uint16)
        tallies = np.empty(WORD * BLOCK if trains else 0, np.uint8)
        held = np.empty((*out.shape[::2], WORD) if trains else (0, 0, 0), np.uint64)
        for lane in range(0, lanes, wide):
            carried(state, lanes, lane, sa_only, block, False)
            for i in range(groups):
                n_pieces[i] = planned(addresses, lengths, lane + i * RUN, pieces[i])
            n = lengths[lane : lane + wide].max()
            tally, row, place = no_spikes(), 0, 0
            for first in range(0, n, AT_A_TIME):
                stop = min(first + AT_A_TIME, n)
                for i in range(groups):
                    lie = found(pieces[i], n_pieces[i], row_bytes, first, stop, copies)
                    at = i * RUN
                    currents(*lie, stop - first, of_lanes, lane + at, k, state, block, at, ways)
                for t in range(first, stop):
                    call_up(pieces, row_bytes, t + AT_A_TIME)
                    w = OWN_W + (t - first) * BLOCK
                    if late:
                        tally = counted(tally, published_sample(block, w, k, substeps))
                    for _ in range(0 if late else substeps):
                        tally = counted(tally, substep(block, w, c, old_v, coupled))
                    if trains:
                        store(tallies, place, tally)
                        tally, place = no_spikes(), place + BLOCK
                    elif t + 1 == ends[row]:
                        at = (lane // wide * rows + row) * BLOCK
                        store(out, at, in_order(tally))
                        if traced:
                            copied(trace, at, block, 0, True)
                            copied(trace, at + UNIT, block, UNIT, True)
                        tally, row = no_spikes(), row + 1
                if trains and (place == WORD * BLOCK or stop == n):
                    most = max(most, keep(tallies, place // BLOCK, held, row))
                    row, place = row + 1, 0
            if trains:
                hand_over(held, row, out, lane // wide * BLOCK)
            carried(state, lanes, lane, sa_only, block, True)
        return most

    compile_advance = numba.njit(
        cache=True, nogil=True, fastmath=False, error_model="numpy", boundscheck=False
    )
    compiled: Kernel = compile_advance(advance)
    return compiled
