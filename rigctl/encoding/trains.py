"""Spike trains of many trials side by side, gathered from counts of each sample.

Spikes are few, and a branch for each of them costs more than the kernel. So 64 samples of 64 trains
are taken as bits and turned about, so that a word holds one train. When all is in, the words tell
how much memory each trial's trains need, and their bits are written there eight at a time by a
table, or where a sample holds several spikes one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numpy.typing import NDArray

from rigctl.encoding.blocks import filled_up
from rigctl.encoding.compiled import BLOCK, LANES
from rigctl.encoding.lanes import emitted, pointer, splat
from rigctl.values import Spikes

# Bits of a word, and trains of a block: 32 of SA and 32 of RA.
WORD = BLOCK
NONE, ONE = np.uint64(0), np.uint64(1)

# Which bits of a byte are set, the lowest first; what follows is written over or lies behind all.
BITS = 8
PLACES = np.zeros((256, BITS), np.uint8)
for _byte in range(256):
    _set = [bit for bit in range(BITS) if _byte >> bit & 1]
    PLACES[_byte, : len(_set)] = _set

Words = NDArray[np.uint64]


class Trains:
    """Spike trains of trials side by side, gathered stretch by stretch.

    ``memory``: of trains gathered before, to be used again as with a tile.
    """

    def __init__(self, trials: Sequence[NDArray[np.uint16]], memory: Words | None = None) -> None:
        self._n_taxels = trials[0].shape[1]
        self._lengths = [len(samples) for samples in trials]
        self._trains = 2 * filled_up(len(trials) * self._n_taxels, LANES)
        self._in_train = -(-max(self._lengths) // WORD)
        self.memory = np.empty(0, np.uint64) if memory is None else memory
        self._planes = 0

    def add(self, counts: NDArray[np.uint8], start: int) -> None:
        """Take in the counts of each sample, uint8 (blocks, n, 2, 32), from sample ``start``.

        Stretches come in order, each but the last of a multiple of 64 samples.
        """
        self._make_room(int(counts.max(initial=0)))
        _take_compiled(counts, start // WORD, self._words())

    def spikes(self) -> list[Spikes]:
        """The trains of each trial."""
        return [self._of_trial(place, n) for place, n in enumerate(self._lengths)]

    def _words(self) -> Words:
        """Samples of each train with more than 0, 1, 2 … spikes: (planes, trains, words)."""
        shape = (self._planes, self._trains, self._in_train)
        return self.memory[: self._planes * self._trains * self._in_train].reshape(shape)

    def _make_room(self, planes: int) -> None:
        if planes <= self._planes:
            return
        before, size = self._words(), planes * self._trains * self._in_train
        if self.memory.size < size:
            self.memory = np.empty(size, np.uint64)
        first, self._planes = self._planes, planes
        words = self._words()
        words[:first] = before
        words[first:] = 0

    def _of_trial(self, place: int, n_samples: int) -> Spikes:
        lanes = np.arange(place * self._n_taxels, (place + 1) * self._n_taxels)
        sa = lanes // LANES * WORD + lanes % LANES
        trains = np.concatenate([sa, sa + LANES])
        starts = np.zeros(len(trains) + 1, np.int64)
        words = self._words()
        _count_compiled(words, trains, n_samples, starts)
        samples = np.empty(starts[-1] + BITS, np.int32)
        write = _write_compiled if self._planes <= 1 else _write_several_compiled
        write(words, trains, n_samples, starts, PLACES, samples)
        return Spikes(starts, samples[: starts[-1]], n_samples)


@emitted
def above(_typing: Any, tallies: Any, index: Any, low: Any) -> Any:
    """Which of 64 tallies, from a flat index on, are above ``low``: one bit each."""
    vector = ir.VectorType(ir.IntType(8), WORD)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        tallies, index, low = arguments
        place = pointer(context, builder, signature.args[0], tallies, index, vector)
        same = splat(builder, builder.trunc(low, vector.element), vector)
        some = builder.icmp_unsigned(">", builder.load(place, align=1), same)
        return builder.bitcast(some, ir.IntType(64))

    return types.uint64(tallies, types.intp, types.intp), generate


@emitted
def write_bits(_typing: Any, out: Any, at: Any, first: Any, places: Any, byte: Any) -> Any:
    """Write ``first`` + place of each bit of a byte that is set, in a row of eight numbers."""
    few, numbers = ir.VectorType(ir.IntType(8), BITS), ir.VectorType(ir.IntType(32), BITS)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        out, at, first, places, byte = arguments
        row = builder.mul(byte, byte.type(BITS))
        source = pointer(context, builder, signature.args[3], places, row, few)
        target = pointer(context, builder, signature.args[0], out, at, numbers)
        same = splat(builder, builder.trunc(first, numbers.element), numbers)
        offsets = builder.zext(builder.load(source, align=1), numbers)
        builder.store(builder.add(same, offsets), target, align=4)
        return context.get_dummy_value()

    return types.void(out, types.intp, types.intp, places, types.intp), generate


@emitted
def ones(_typing: Any, bits: Any) -> Any:
    """How many bits are set."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.intp(types.uint64), generate


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


def _take(counts: Any, first: Any, words: Any) -> None:
    """Put counts, uint8 (blocks, n, 2, 32), into the planes of words from the ``first`` word on."""
    blocks, n = counts.shape[:2]
    turned = np.empty(WORD, np.uint64)
    for plane in range(words.shape[0]):
        for block in range(blocks):
            for t in range(0, n, WORD):
                inside = min(WORD, n - t)
                for i in range(inside):
                    turned[i] = above(counts, (block * n + t + i) * WORD, plane)
                turned[inside:] = NONE
                _turn_compiled(turned)
                for place in range(WORD):
                    words[plane, block * WORD + place, first + t // WORD] = turned[place]


def _own(words: Any, plane: Any, train: Any, i: Any, n_samples: Any) -> Any:
    """A word of a train, without what it shows behind its trial's end."""
    bits, left = words[plane, train, i], n_samples - i * WORD
    return bits if left >= WORD else bits & ((ONE << np.uint64(left)) - ONE)


def _count(words: Any, trains: Any, n_samples: Any, starts: Any) -> None:
    """Where each of the trains ends if they are laid one behind the other."""
    for i in range(trains.shape[0]):
        n = 0
        for plane in range(words.shape[0]):
            for j in range((n_samples + WORD - 1) // WORD):
                n += ones(_own_compiled(words, plane, trains[i], j, n_samples))
        starts[i + 1] = starts[i] + n


def _write(words: Any, trains: Any, n_samples: Any, starts: Any, places: Any, out: Any) -> None:
    """Write the sample of each spike, train after train, where no sample holds two."""
    for i in range(trains.shape[0] if words.shape[0] else 0):
        at = starts[i]
        for j in range((n_samples + WORD - 1) // WORD):
            bits = _own_compiled(words, 0, trains[i], j, n_samples)
            for first in range(j * WORD, (j + 1) * WORD, BITS):
                byte = bits & np.uint64(2**BITS - 1)
                write_bits(out, at, first, places, np.intp(byte))
                at += ones(byte)
                bits >>= np.uint64(BITS)


def _write_several(
    words: Any, trains: Any, n_samples: Any, starts: Any, _places: Any, out: Any
) -> None:
    """The same where a sample may hold several spikes, plane after plane within each."""
    for i in range(trains.shape[0]):
        at = starts[i]
        for t in range(n_samples):
            for plane in range(words.shape[0]):
                if words[plane, trains[i], t // WORD] >> np.uint64(t % WORD) & ONE:
                    out[at] = t
                    at += 1


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
_turn_compiled, _own_compiled = _compile(_turn), _compile(_own)
_take_compiled, _count_compiled = _compile(_take), _compile(_count)
_write_compiled, _write_several_compiled = _compile(_write), _compile(_write_several)
