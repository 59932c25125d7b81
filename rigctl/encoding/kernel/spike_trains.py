"""Spike trains of many trials side by side, written from bits.

Spikes are few, and a branch for each of them costs more than the kernel. So the kernel keeps 64
samples of a train as the bits of a word. When all is in, the words tell how much memory the trains
need, and their bits are written there eight at a time by a table, or where a sample holds several
spikes one by one.
"""

from __future__ import annotations

from itertools import pairwise
from math import prod
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rigctl.encoding.kernel.machine_code import LANES
from rigctl.encoding.kernel.neuron_blocks import NeuronBlocks
from rigctl.encoding.kernel.prefetch import TrialRows
from rigctl.encoding.kernel.simd import emitted, pointer, splat
from rigctl.encoding.kernel.transpose_bits import LINE, WORD
from rigctl.values import Spikes

ONE = np.uint64(1)

# Which bits of a byte are set, the lowest first; what follows is written over or lies behind all.
BITS = 8
PLACES = np.zeros((256, BITS), np.uint8)
for _byte in range(256):
    _set = [bit for bit in range(BITS) if _byte >> bit & 1]
    PLACES[_byte, : len(_set)] = _set

Words = NDArray[np.uint64]


class SpikeTrains:
    """Spike trains of tile after tile, with the same memory for their bits.

    ``highest``: most spikes that a sample may hold. As long as none holds two, one bit is kept.
    """

    def __init__(self, highest: int) -> None:
        self._highest, self._planes = highest, 1
        self._memory = np.empty(0, np.uint64)

    def of(self, blocks: NeuronBlocks, rows: TrialRows, n_taxels: int) -> list[Spikes]:
        """Encode trials side by side, from rest: the trains of each."""
        words = self._room(2 * blocks.lanes, int(rows.lengths.max()))
        most = blocks.take_trains(rows, words)
        if most > self._planes:
            self._planes = self._highest
            blocks.reset()
            words = self._room(2 * blocks.lanes, int(rows.lengths.max()))
            most = blocks.take_trains(rows, words)
        trains = _places(len(rows), n_taxels)
        starts = np.zeros(len(trains) + 1, np.int64)
        lengths = np.repeat(rows.lengths, 2 * n_taxels)
        _count_compiled(words[:most], trains, lengths, starts)
        samples = np.empty(starts[-1] + BITS, np.int32)
        write = _write_compiled if most <= 1 else _write_several_compiled
        write(words[:most], trains, lengths, starts, PLACES, samples)
        return _by_trial(starts, samples, rows.lengths, 2 * n_taxels)

    def _room(self, trains: int, n_samples: int) -> Words:
        """Words for so many trains, uint64 (planes, trains, words), whole lines of the cache."""
        words = -(-n_samples // (WORD * LINE)) * LINE
        shape = (self._planes, trains, words)
        if self._memory.size < prod(shape):
            self._memory = np.empty(prod(shape), np.uint64)
        return self._memory[: prod(shape)].reshape(shape)


def _by_trial(
    starts: NDArray[np.int64],
    samples: NDArray[np.int32],
    lengths: NDArray[np.int64],
    per_trial: int,
) -> list[Spikes]:
    """Spikes of each trial, of trains that lie trial after trial."""
    begins = starts[::per_trial]
    of_trial = per_trial * np.arange(len(lengths))[:, None] + np.arange(per_trial + 1)
    row_starts = starts[of_trial] - begins[:-1, None]
    several = zip(row_starts, pairwise(begins.tolist()), lengths.tolist(), strict=True)
    return [Spikes(own, samples[begin:end], n) for own, (begin, end), n in several]


def _places(n_trials: int, n_taxels: int) -> NDArray[np.int64]:
    """Which of the blocks' trains are a trial's, SA then RA, trial after trial."""
    lanes = np.arange(n_trials * n_taxels).reshape(n_trials, n_taxels)
    sa = lanes // LANES * WORD + lanes % LANES
    return np.concatenate([sa, sa + LANES], axis=1).reshape(-1)


@emitted
def write_word(_typing: Any, out: Any, at: Any, first: Any, places: Any, bits: Any) -> Any:
    """Write ``first`` + place of each bit that is set, from ``at`` on: where the next one goes.

    Eight bits at a time, in a row of eight numbers; what of it is no spike is written over.
    """
    few, numbers = ir.VectorType(ir.IntType(8), BITS), ir.VectorType(ir.IntType(32), BITS)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, at, first, places, bits = arguments
        same = splat(builder, builder.trunc(first, numbers.element), numbers)
        for shift in range(0, WORD, BITS):
            byte = builder.and_(builder.lshr(bits, bits.type(shift)), bits.type(2**BITS - 1))
            row = builder.mul(byte, byte.type(BITS))
            source = pointer(context, builder, signature.args[3], places, row, few)
            target = pointer(context, builder, signature.args[0], out, at, numbers)
            begin = builder.add(same, ir.Constant(numbers, [shift] * BITS))
            offsets = builder.zext(builder.load(source, align=1), numbers)
            builder.store(builder.add(begin, offsets), target, align=4)
            at = builder.add(at, builder.ctpop(byte))
        return at

    return types.intp(out, types.intp, types.intp, places, types.uint64), generate


@emitted
def ones(_typing: Any, bits: Any) -> Any:
    """How many bits are set."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.intp(types.uint64), generate


def _rest(words: Any, plane: Any, train: Any, n_samples: Any) -> Any:
    """A train's last samples, which fill no word, without what it shows behind its trial's end."""
    left = np.uint64(n_samples % WORD)
    return words[plane, train, n_samples // WORD] & ((ONE << left) - ONE) if left else ONE - ONE


def _count(words: Any, trains: Any, lengths: Any, starts: Any) -> None:
    """Where each of the trains ends if they are laid one behind the other."""
    for i in range(trains.shape[0]):
        n = 0
        for plane in range(words.shape[0]):
            for j in range(lengths[i] // WORD):
                n += ones(words[plane, trains[i], j])
            n += ones(_rest_compiled(words, plane, trains[i], lengths[i]))
        starts[i + 1] = starts[i] + n


def _write(words: Any, trains: Any, lengths: Any, starts: Any, places: Any, out: Any) -> None:
    """Write the sample of each spike, train after train, where no sample holds two."""
    for i in range(trains.shape[0] if words.shape[0] else 0):
        at, full = starts[i], lengths[i] // WORD
        for j in range(full):
            at = write_word(out, at, j * WORD, places, words[0, trains[i], j])
        rest = _rest_compiled(words, 0, trains[i], lengths[i])
        write_word(out, at, full * WORD, places, rest)


def _write_several(
    words: Any, trains: Any, lengths: Any, starts: Any, _places: Any, out: Any
) -> None:
    """The same where a sample may hold several spikes, plane after plane within each."""
    for i in range(trains.shape[0]):
        at = starts[i]
        for t in range(lengths[i]):
            for plane in range(words.shape[0]):
                if words[plane, trains[i], t // WORD] >> np.uint64(t % WORD) & ONE:
                    out[at] = t
                    at += 1


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_rest_compiled, _count_compiled = _compile(_rest), _compile(_count)
_write_compiled, _write_several_compiled = _compile(_write), _compile(_write_several)
