"""Spike trains of many trials side by side, gathered from counts of each sample.

Spikes are few, and a branch for each of them costs more than the kernel. So 64 samples of 64 trains
are taken as bits, turned about so that a word holds one train, and each word's places are written
without a branch, or where the processor has no instruction for that with one for each.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numpy.typing import NDArray

from rigctl.encoding.blocks import filled_up
from rigctl.encoding.compiled import LANES, MASKED, emitted, pointer
from rigctl.values import Spikes

# Trains of a block, 32 of SA and 32 of RA, and bits of a word.
WORD = 2 * LANES
# Samples that are written at a time.
RUN = 16
NONE, ONE, ALL = np.uint64(0), np.uint64(1), np.uint64(2**64 - 1)


class Trains:
    """Spike trains of trials side by side, gathered stretch by stretch.

    ``memory``: of trains gathered before, to be used again as with a tile.
    """

    def __init__(
        self, trials: Sequence[NDArray[np.uint16]], memory: NDArray[np.int32] | None = None
    ) -> None:
        self._n_taxels = trials[0].shape[1]
        self._lengths = [len(samples) for samples in trials]
        lanes = len(trials) * self._n_taxels
        self._in_lane = np.zeros(filled_up(lanes, LANES), np.int64)
        self._in_lane[:lanes] = np.repeat(self._lengths, self._n_taxels)
        self._n_spikes = np.zeros(2 * len(self._in_lane), np.int64)
        self.memory = np.empty(0, np.int32) if memory is None else memory
        self._room = self.memory.size // len(self._n_spikes)

    def add(self, counts: NDArray[np.uint8], start: int) -> None:
        """Take in the counts of each sample, uint8 (blocks, n, 2, 32), from sample ``start``."""
        most = int(counts.max(initial=0))
        self._make_room(int(self._n_spikes.max()) + most * counts.shape[1])
        take = _take_compiled if most <= 1 else _take_several_compiled
        take(counts, start, self._in_lane, self._samples(), self._n_spikes)

    def spikes(self) -> list[Spikes]:
        """The trains of each trial."""
        return [self._of_trial(place, n) for place, n in enumerate(self._lengths)]

    def _samples(self) -> NDArray[np.int32]:
        """Samples of the spikes of each train, int32 (trains, room)."""
        trains = len(self._n_spikes)
        return self.memory[: trains * self._room].reshape(trains, self._room)

    def _make_room(self, spikes: int) -> None:
        if self._room >= spikes:
            return
        before, used = self._samples(), int(self._n_spikes.max())
        self._room = max(2 * spikes, max(self._lengths) // 3)
        self.memory = np.empty(len(self._n_spikes) * self._room, np.int32)
        self._samples()[:, :used] = before[:, :used]

    def _of_trial(self, place: int, n_samples: int) -> Spikes:
        lanes = np.arange(place * self._n_taxels, (place + 1) * self._n_taxels)
        sa = lanes // LANES * WORD + lanes % LANES
        trains = np.concatenate([sa, sa + LANES])
        starts = np.zeros(len(trains) + 1, np.int64)
        np.cumsum(self._n_spikes[trains], out=starts[1:])
        samples = np.empty(starts[-1], np.int32)
        _gather_compiled(self._samples(), trains, starts, samples)
        return Spikes(starts, samples, n_samples)


@emitted
def spiking(_typing: Any, tallies: Any, index: Any) -> Any:
    """Which of 64 tallies, from a flat index on, are not 0: one bit each."""
    vector = ir.VectorType(ir.IntType(8), 64)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = pointer(context, builder, signature.args[0], arguments[0], arguments[1], vector)
        some = builder.icmp_unsigned("!=", builder.load(place, align=1), vector([0] * 64))
        return builder.bitcast(some, ir.IntType(64))

    return types.uint64(tallies, types.intp), generate


@emitted
def write_places(_typing: Any, out: Any, index: Any, first: Any, bits: Any) -> Any:
    """Write ``first`` + place of each bit that is set, from a flat index on; the index behind."""
    number, mask = ir.IntType(32), ir.VectorType(ir.IntType(1), RUN)
    numbers = ir.VectorType(number, RUN)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, at, first, bits = arguments
        shape = ir.FunctionType(ir.VoidType(), [numbers, number.as_pointer(), mask])
        get: Any = cgutils.get_or_insert_function
        squeeze = get(builder.module, shape, f"llvm.masked.compressstore.v{RUN}i32")
        data = context.make_array(signature.args[0])(context, builder, out).data
        empty = ir.Constant(numbers, ir.Undefined)
        one = builder.insert_element(empty, builder.trunc(first, number), number(0))
        same = builder.shuffle_vector(one, empty, ir.Constant(numbers, [0] * RUN))
        for run in range(0, WORD, RUN):
            some = builder.trunc(builder.lshr(bits, bits.type(run)), ir.IntType(RUN))
            places = builder.add(same, ir.Constant(numbers, list(range(run, run + RUN))))
            place = builder.gep(data, [at])
            builder.call(squeeze, [places, place, builder.bitcast(some, mask)])
            at = builder.add(at, builder.zext(builder.ctpop(some), at.type))
        return at

    return types.intp(out, types.intp, types.intp, types.uint64), generate


@emitted
def lowest(_typing: Any, bits: Any) -> Any:
    """Place of the lowest bit that is set; there is one."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), generate


def _write_one_by_one(out: Any, at: Any, first: Any, bits: Any) -> Any:
    """What ``write_places`` does, for processors that cannot squeeze a vector."""
    while bits != NONE:
        out[at] = first + np.int64(lowest(bits))
        bits &= bits - ONE
        at += 1
    return at


def _turn(rows: Any) -> None:
    """Turn 64 words of 64 bits about: bit j of word i becomes bit i of word j."""
    half, mask = WORD // 2, np.uint64(2 ** (WORD // 2) - 1)
    while half:
        by = np.uint64(half)
        for first in range(0, WORD, 2 * half):
            for i in range(first, first + half):
                swapped = ((rows[i] >> by) ^ rows[i + half]) & mask
                rows[i] ^= swapped << by
                rows[i + half] ^= swapped
        half //= 2
        mask ^= mask << np.uint64(half)


def _take(counts: Any, start: Any, in_lane: Any, samples: Any, n_spikes: Any) -> None:
    """Write the sample of each spike behind those that its train, a row of ``samples``, has.

    ``counts``: 0 or 1 each. ``n_spikes``: int64 (trains,), of each train so far; 32 trains of SA
    and 32 of RA for a block. What a train shows behind its trial's end is left out.
    """
    blocks, n = counts.shape[:2]
    flat, room = samples.reshape(-1), samples.shape[1]
    words = np.empty(WORD, np.uint64)
    for block in range(blocks):
        for t in range(0, n, WORD):
            for i in range(WORD):
                inside = t + i < n
                words[i] = spiking(counts, (block * n + t + i) * WORD) if inside else NONE
            _turn_compiled(words)
            for place in range(WORD):
                left = in_lane[block * LANES + place % LANES] - (start + t)
                if left <= 0:
                    continue
                own = ALL if left >= WORD else (ONE << np.uint64(left)) - ONE
                train = block * WORD + place
                at = train * room + n_spikes[train]
                end = _write(flat, at, start + t, words[place] & own)
                n_spikes[train] += end - at


def _take_several(counts: Any, start: Any, in_lane: Any, samples: Any, n_spikes: Any) -> None:
    """The same where a sample may hold several spikes, one count after the other."""
    for block in range(counts.shape[0]):
        for t in range(counts.shape[1]):
            for place in range(WORD):
                channel, lane = place // LANES, place % LANES
                train = block * WORD + place
                if start + t < in_lane[block * LANES + lane]:
                    for _ in range(counts[block, t, channel, lane]):
                        samples[train, n_spikes[train]] = start + t
                        n_spikes[train] += 1


def _gather(samples: Any, trains: Any, starts: Any, out: Any) -> None:
    """Some trains one behind the other."""
    for i in range(trains.shape[0]):
        row = samples[trains[i]]
        for spike in range(starts[i + 1] - starts[i]):
            out[starts[i] + spike] = row[spike]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_turn_compiled = _compile(_turn)
_write = write_places if MASKED else _compile(_write_one_by_one)
_take_compiled = _compile(_take)
_take_several_compiled = _compile(_take_several)
_gather_compiled = _compile(_gather)
