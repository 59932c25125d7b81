"""Encode the spike trains of many trials side by side, by way of bits.

Spikes are few, and a branch for each of them costs more than the kernel. So the kernel packs 64
samples of a train into the bits of a word. At the end the words tell how much memory the trains
need, and a table turns eight bits at a time into samples; where a sample has several spikes, the
bits are read one by one.
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

from rigctl.encoder.kernel.constants import max_spikes_per_sample
from rigctl.encoder.kernel.neuron_blocks import NeuronBlocks
from rigctl.encoder.kernel.prefetch import TrialViews
from rigctl.encoder.kernel.simd import HALF_LANES, intrinsic, pointer, splat
from rigctl.encoder.kernel.transpose_bits import LINE_WORDS, WORD
from rigctl.encoder.parameters import EncoderParameters
from rigctl.values import Spikes

ONE = np.uint64(1)

# The set bits of each byte, lowest first; the rest of a row is overwritten or behind all spikes.
BITS = 8
SET_BITS = np.zeros((256, BITS), np.uint8)
for _byte in range(256):
    _set = [bit for bit in range(BITS) if _byte >> bit & 1]
    SET_BITS[_byte, : len(_set)] = _set

Words = NDArray[np.uint64]


class TrainEncoder:
    """Encoder of one tile of trials after another, which reuses the memory of the bits.

    It stores one bit a sample until a sample has two spikes.
    """

    def __init__(self, parameters: EncoderParameters) -> None:
        self._max_spikes, self._planes = max_spikes_per_sample(parameters), 1
        self._memory = np.empty(0, np.uint64)

    def encode(self, blocks: NeuronBlocks, views: TrialViews) -> list[Spikes]:
        """Encode trials side by side from rest; return the trains of each."""
        words = self._words(2 * blocks.lanes, int(views.lengths.max()))
        highest = blocks.encode_bits(views, words)
        if highest > self._planes:
            self._planes = self._max_spikes
            blocks.reset()
            words = self._words(2 * blocks.lanes, int(views.lengths.max()))
            highest = blocks.encode_bits(views, words)
        trains = _block_trains(len(views), blocks.n_taxels)
        starts = np.zeros(len(trains) + 1, np.int64)
        lengths = np.repeat(views.lengths, 2 * blocks.n_taxels)
        _find_starts_compiled(words[:highest], trains, lengths, starts)
        samples = np.empty(starts[-1] + BITS, np.int32)
        write = _write_compiled if highest <= 1 else _write_several_compiled
        write(words[:highest], trains, lengths, starts, SET_BITS, samples)
        return _split_trials(starts, samples, views.lengths, 2 * blocks.n_taxels)

    def _words(self, trains: int, n_samples: int) -> Words:
        """Return memory for words, uint64 (planes, trains, words), in whole cache lines."""
        words = -(-n_samples // (WORD * LINE_WORDS)) * LINE_WORDS
        shape = (self._planes, trains, words)
        if self._memory.size < prod(shape):
            self._memory = np.empty(prod(shape), np.uint64)
        return self._memory[: prod(shape)].reshape(shape)


def _split_trials(
    starts: NDArray[np.int64],
    samples: NDArray[np.int32],
    lengths: NDArray[np.int64],
    trial_trains: int,
) -> list[Spikes]:
    """Return the spikes of each trial from trains in the order of the trials."""
    begins = starts[::trial_trains]
    trains = trial_trains * np.arange(len(lengths))[:, None] + np.arange(trial_trains + 1)
    row_starts = starts[trains] - begins[:-1, None]
    trials = zip(row_starts, pairwise(begins.tolist()), lengths.tolist(), strict=True)
    return [Spikes(rows, samples[begin:end], n) for rows, (begin, end), n in trials]


def _block_trains(n_trials: int, n_taxels: int) -> NDArray[np.int64]:
    """Return the index of each train in the blocks, SA then RA, trial after trial."""
    lanes = np.arange(n_trials * n_taxels).reshape(n_trials, n_taxels)
    sa = lanes // HALF_LANES * WORD + lanes % HALF_LANES
    return np.concatenate([sa, sa + HALF_LANES], axis=1).reshape(-1)


@intrinsic
def _write_word(_typing: Any, out: Any, at: Any, first: Any, set_bits: Any, bits: Any) -> Any:
    """Write ``first`` + index of each set bit from ``at`` on; return the place of the next one.

    Writes eight numbers for eight bits at a time; the next ones overwrite what is no spike.
    """
    few, numbers = ir.VectorType(ir.IntType(8), BITS), ir.VectorType(ir.IntType(32), BITS)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, at, first, set_bits, bits = arguments
        firsts = splat(builder, builder.trunc(first, numbers.element), numbers)
        for shift in range(0, WORD, BITS):
            byte = builder.and_(builder.lshr(bits, bits.type(shift)), bits.type(2**BITS - 1))
            row = builder.mul(byte, byte.type(BITS))
            source = pointer(context, builder, signature.args[3], set_bits, row, few)
            target = pointer(context, builder, signature.args[0], out, at, numbers)
            begin = builder.add(firsts, ir.Constant(numbers, [shift] * BITS))
            offsets = builder.zext(builder.load(source, align=1), numbers)
            builder.store(builder.add(begin, offsets), target, align=4)
            at = builder.add(at, builder.ctpop(byte))
        return at

    return types.intp(out, types.intp, types.intp, set_bits, types.uint64), generate


@intrinsic
def _count_bits(_typing: Any, bits: Any) -> Any:
    """Return the number of set bits."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.intp(types.uint64), generate


def _last_word(words: Any, plane: Any, train: Any, n_samples: Any) -> Any:
    """Return the bits of a train's last, partial word, without those behind its trial's end."""
    left = np.uint64(n_samples % WORD)
    return words[plane, train, n_samples // WORD] & ((ONE << left) - ONE) if left else ONE - ONE


def _find_starts(words: Any, trains: Any, lengths: Any, starts: Any) -> None:
    """Find where each train ends if all are stored one after the other."""
    for i in range(trains.shape[0]):
        n = 0
        for plane in range(words.shape[0]):
            for j in range(lengths[i] // WORD):
                n += _count_bits(words[plane, trains[i], j])
            n += _count_bits(_last_word_compiled(words, plane, trains[i], lengths[i]))
        starts[i + 1] = starts[i] + n


def _write(words: Any, trains: Any, lengths: Any, starts: Any, set_bits: Any, out: Any) -> None:
    """Write the sample of each spike, train after train, where no sample has two."""
    for i in range(trains.shape[0] if words.shape[0] else 0):
        at, n_full = starts[i], lengths[i] // WORD
        for j in range(n_full):
            at = _write_word(out, at, j * WORD, set_bits, words[0, trains[i], j])
        last = _last_word_compiled(words, 0, trains[i], lengths[i])
        _write_word(out, at, n_full * WORD, set_bits, last)


def _write_several(
    words: Any, trains: Any, lengths: Any, starts: Any, _set_bits: Any, out: Any
) -> None:
    """Write the same where a sample may have several spikes, plane after plane within each."""
    for i in range(trains.shape[0]):
        at = starts[i]
        for t in range(lengths[i]):
            for plane in range(words.shape[0]):
                if words[plane, trains[i], t // WORD] >> np.uint64(t % WORD) & ONE:
                    out[at] = t
                    at += 1


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_last_word_compiled, _find_starts_compiled = _compile(_last_word), _compile(_find_starts)
_write_compiled, _write_several_compiled = _compile(_write), _compile(_write_several)
