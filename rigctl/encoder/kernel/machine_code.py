"""Compile the kernel, which takes a block of 64 neurons at a time through all samples.

It computes the currents of a few samples, eight lanes at a time; then all neurons of the block
advance through these samples substep by substep (in schemes that reset at the next sample, 32 of
them sample by sample). Byte counters count the spikes of 32 lanes at a time; the kernel writes them
as counts of rows of samples, or packs them into the bits of trains.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np

from rigctl.encoder.kernel.neuron_step import (
    BLOCK,
    BLOCK_SIZE,
    BLOCK_W,
    CHUNK_SAMPLES,
    COUPLING,
    DECAY,
    JUMP,
    RESET_TO,
    THRESHOLD,
    carry_state,
    compute_currents,
    published_sample,
    substep,
)
from rigctl.encoder.kernel.prefetch import (
    COPY_ROW,
    RUN,
    SEGMENT_FIELDS,
    locate_run,
    plan_run,
    prefetch_sample,
)
from rigctl.encoder.kernel.simd import HALF_LANES, broadcast, stack_memory, store
from rigctl.encoder.kernel.spike_counters import add_spikes, to_lane_order, zero_counters
from rigctl.encoder.kernel.transpose_bits import WORD, pack_words, transpose_words

Kernel = Callable[..., int]

# numba's disk cache checks the text of this file only, and what a closure holds: so a kernel holds
# a checksum of the other files that it is compiled from.
_PARTS = ("transpose_bits.py", "prefetch.py", "simd.py", "neuron_step.py", "spike_counters.py")
_FILES = (Path(__file__).with_name(name) for name in _PARTS)
_CHECKSUM = zlib.crc32(b"".join(file.read_bytes() for file in _FILES))


def lanes_per_block(sa_only: bool) -> int:
    """Return the lanes of a block: 32 with SA and RA, 64 with SA alone."""
    return BLOCK if sa_only else HALF_LANES


@cache
def compile_kernel(
    *,
    substeps: int,
    old_v: bool,
    coupled: bool,
    late_reset: bool,
    signed: bool,
    sa_only: bool,
    trains: bool,
) -> Kernel:
    """Compile one scheme; see :func:`rigctl.encoder.kernel.constants.kernel_for` for its call.

    The arguments are constants of the compiled code, not tests at run time. numba stores closures
    over plain numbers in its disk cache.
    """
    block_lanes, checksum = lanes_per_block(sa_only), _CHECKSUM
    runs = block_lanes // RUN

    def advance(
        addresses: Any, lengths: Any, row_bytes: Any, low: Any, width: Any, scale: Any,
        sa_drive: Any, ra_drive: Any, k: Any, state: Any, ends: Any, out: Any,
    ) -> int:  # fmt: skip
        _ = checksum
        lanes, rows, highest = low.shape[0], ends.shape[0], 0
        ranges, options = (low, width, scale, sa_drive, ra_drive), (late_reset, signed, sa_only)
        reset = (broadcast(k[THRESHOLD], 1), broadcast(k[RESET_TO], 1), broadcast(k[JUMP], 1))
        c = (broadcast(k[COUPLING], 1), broadcast(k[DECAY], 1), *reset)
        block = stack_memory("float64", BLOCK_SIZE)
        n_segments = np.empty(runs, np.int64)
        segments = np.empty((runs, RUN, SEGMENT_FIELDS), np.int64)
        copies = np.zeros(CHUNK_SAMPLES * COPY_ROW, np.uint16)
        history = np.empty(WORD * BLOCK if trains else 0, np.uint8)
        packed = np.empty((*out.shape[::2], WORD) if trains else (0, 0, 0), np.uint64)
        for lane in range(0, lanes, block_lanes):
            carry_state(state, lanes, lane, sa_only, block, False)
            for i in range(runs):
                n_segments[i] = plan_run(addresses, lengths, lane + i * RUN, segments[i])
            n = lengths[lane : lane + block_lanes].max()
            counters, row, place = zero_counters(), 0, 0
            for first in range(0, n, CHUNK_SAMPLES):
                stop = min(first + CHUNK_SAMPLES, n)
                for i in range(runs):
                    run = locate_run(segments[i], n_segments[i], row_bytes, first, stop, copies)
                    at = i * RUN
                    compute_currents(
                        *run, stop - first, ranges, lane + at, k, state, block, at, options
                    )
                for t in range(first, stop):
                    prefetch_sample(segments, row_bytes, t + CHUNK_SAMPLES)
                    w = BLOCK_W + (t - first) * BLOCK
                    if late_reset:
                        counters = add_spikes(counters, published_sample(block, w, k, substeps))
                    for _ in range(0 if late_reset else substeps):
                        counters = add_spikes(counters, substep(block, w, c, old_v, coupled))
                    if trains:
                        store(history, place, counters)
                        counters, place = zero_counters(), place + BLOCK
                    elif t + 1 == ends[row]:
                        at = (lane // block_lanes * rows + row) * BLOCK
                        store(out, at, to_lane_order(counters))
                        counters, row = zero_counters(), row + 1
                if trains and (place == WORD * BLOCK or stop == n):
                    highest = max(highest, pack_words(history, place // BLOCK, packed, row))
                    row, place = row + 1, 0
            if trains:
                transpose_words(packed, row, out, lane // block_lanes * BLOCK)
            carry_state(state, lanes, lane, sa_only, block, True)
        return highest

    compile_advance = numba.njit(
        cache=True, nogil=True, fastmath=False, error_model="numpy", boundscheck=False
    )
    compiled: Kernel = compile_advance(advance)
    return compiled
