"""Spikes of 64 samples of a block's 64 trains, turned about: a word of 64 bits for each train.

Eight samples of a train are pushed bit by bit into a byte, for all trains at once; then the eight
bytes of each train are brought together.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types

from rigctl.encoding.lanes import (
    UNIT,
    VECTORS,
    Lanes,
    call,
    elementwise,
    emitted,
    load,
    parts,
    pointer,
    splat,
    store,
    whole,
)
from rigctl.encoding.tally import PLACES, no_spikes

# Bits of a word, and trains of a block.
WORD = 2 * UNIT
BYTE = 8
# Bytes of half a vector: what processors interleave, they interleave within such halves.
HALF = UNIT // 2


def _interleaved(bits: int, upper: int) -> list[int]:
    """Which numbers, so wide each, of two vectors follow each other if a half of each is taken."""
    n = BYTE * HALF // bits
    first = n // 2 if upper else 0
    return [
        v * 2 * n + half * n + first + i for half in (0, 1) for i in range(n // 2) for v in (0, 1)
    ]


def _bytes(numbers: list[int], bits: int) -> list[int]:
    """The same as numbers of bytes."""
    size = bits // BYTE
    return [size * number + i for number in numbers for i in range(size)]


def _brought_together(vectors: list[Any], interleave: Any) -> list[Any]:
    """Eight vectors of bytes as eight of words: the first bytes of all, the second ones …"""
    for bits in (8, 16, 32):
        pairs = [(vectors[i], vectors[i + 1]) for i in range(0, len(vectors), 2)]
        both = [[interleave(*pair, _interleaved(bits, u), bits) for pair in pairs] for u in (0, 1)]
        vectors = [vector for way in both for vector in way]
    return vectors


def _order() -> list[int]:
    """Which byte of a unit's tally each word stands for, in the order in which they come out."""
    first = [[(place, group) for place in range(UNIT)] for group in range(BYTE)]

    def interleave(one: list[Any], other: list[Any], numbers: list[int], bits: int) -> list[Any]:
        return [(one + other)[i] for i in _bytes(numbers, bits)]

    out = [label for vector in _brought_together(first, interleave) for label in vector]
    return [place for place, group in out if group == 0]


# Where the word of each train of a block comes out.
_LANES = [int(PLACES[unit * UNIT + place]) for unit in (0, 1) for place in _order()]
OF_TRAIN = np.array([_LANES.index(train) for train in range(WORD)], np.int64)


@emitted
def pushed(_typing: Any, bits: Any, tally: Any, low: Any) -> Any:
    """Bytes with one more bit at the low end: whether the tally is above ``low``."""
    over, least = f"llvm.usub.sat.v{UNIT}i8", f"llvm.umin.v{UNIT}i8"
    vector = VECTORS["uint8"]

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        low = splat(builder, builder.trunc(arguments[2], vector.element), vector)
        one = ir.Constant(vector, [1] * UNIT)

        def push(bits: Any, tally: Any) -> Any:
            bit = call(builder, least, call(builder, over, tally, low), one)
            return builder.or_(builder.add(bits, bits), bit)

        both = zip(*(parts(builder, each) for each in arguments[:2]), strict=True)
        return whole(builder, [push(*each) for each in both])

    return bits(bits, tally, types.intp), generate


@emitted
def more(_typing: Any, one: Any, other: Any) -> Any:
    """The larger tally of each train."""
    return elementwise(lambda b, *both: call(b, f"llvm.umax.v{UNIT}i8", *both), one, one, other)


@emitted
def largest(_typing: Any, tally: Any) -> Any:
    """Of all tallies of a block."""

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        both = call(b, f"llvm.umax.v{UNIT}i8", *parts(b, arguments[0]))
        name, byte = f"llvm.vector.reduce.umax.v{UNIT}i8", ir.IntType(8)
        function = b.module.globals.get(name) or ir.Function(
            b.module, ir.FunctionType(byte, [both.type]), name
        )
        return b.zext(b.call(function, [both]), ir.IntType(64))

    return types.intp(tally), generate


@emitted
def bring_together(_typing: Any, bits: Any, words: Any) -> Any:
    """Make words, uint64 (64,), of eight rows of bits, uint8 (8 · 64,), by :data:`OF_TRAIN`."""
    kind = Lanes("uint8", 1)

    def generate(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        def place(which: int, index: int) -> Any:
            at, array = ir.Constant(ir.IntType(64), index), arguments[which]
            return pointer(context, b, signature.args[which], array, at, VECTORS[kind.element])

        def interleave(one: Any, other: Any, numbers: list[int], bits: int) -> Any:
            which = ir.Constant(ir.VectorType(ir.IntType(32), UNIT), _bytes(numbers, bits))
            return b.shuffle_vector(one, other, which)

        for unit in (0, 1):
            rows = [b.load(place(0, group * WORD + unit * UNIT), align=1) for group in range(BYTE)]
            for i, vector in enumerate(_brought_together(rows, interleave)):
                b.store(vector, place(1, unit * UNIT + i * UNIT // BYTE), align=8)
        return context.get_dummy_value()

    return types.void(bits, words), generate


def _keep(tallies: Any, n: Any, room: Any, words: Any, train: Any, word: Any) -> int:
    """Put tallies of up to 64 samples, uint8 (64 · 64,) as they are counted, into words.

    ``room``: uint64 (128,). ``words``: uint64 (planes, trains, words); plane p tells of more than
    p spikes, and is written where it is there and there are so many. ``train``: the block's first.
    Returns the largest tally.
    """
    tallies[n * WORD :] = 0
    turned, bits = room[:WORD], room[WORD:].view(np.uint8)
    most, plane = 1, 0
    while plane < min(most, words.shape[0]):
        seen = no_spikes()
        for group in range(BYTE):
            of_group = no_spikes()
            for i in range(BYTE):
                tally = load(tallies, (group * BYTE + BYTE - 1 - i) * WORD, 2)
                of_group, seen = pushed(of_group, tally, plane), more(seen, tally)
            store(bits, group * WORD, of_group)
        bring_together(bits, turned)
        for place in range(WORD):
            words[plane, train + place, word] = turned[OF_TRAIN[place]]
        most, plane = largest(seen), plane + 1
    return most


keep = numba.njit(cache=True, nogil=True, error_model="numpy")(_keep)
