"""Spikes of 64 samples of a block's 64 trains, turned about: a word of 64 bits for each train.

Eight samples of a train are pushed bit by bit into a byte, for all trains at once; then the eight
bytes of each train are brought together. Words of all trains lie side by side until the block is
through, and are then laid one behind the other, train by train.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types

from rigctl.encoding.kernel.simd import (
    UNIT,
    VECTORS,
    call,
    elementwise,
    emitted,
    inlined,
    load,
    own,
    parts,
    pointer,
    splat,
    store,
    whole,
)
from rigctl.encoding.kernel.spike_counters import PLACES, no_spikes

# Bits of a word, and trains of a block.
WORD = 2 * UNIT
BYTE = 8
# Bytes of half a vector: what processors interleave, they interleave within such halves.
HALF = UNIT // 2
# Bytes that eight samples of a block take, and words in a line of the cache.
OF_EIGHT, LINE = BYTE * WORD, 8


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
def pushed(_typing: Any, bits: Any, bit: Any) -> Any:
    """Bytes with one more bit, 0 or 1, at the low end."""
    return elementwise(lambda b, bits, bit: b.or_(b.add(bits, bits), bit), bits, bits, bit)


@emitted
def above(_typing: Any, tally: Any, low: Any) -> Any:
    """1 where the tally is above ``low``, else 0."""
    over, least = f"llvm.usub.sat.v{UNIT}i8", f"llvm.umin.v{UNIT}i8"
    vector = VECTORS["uint8"]

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        low = splat(b, b.trunc(arguments[1], vector.element), vector)
        one, units = ir.Constant(vector, [1] * UNIT), parts(b, arguments[0])
        return whole(b, [call(b, least, call(b, over, unit, low), one) for unit in units])

    return tally(tally, types.intp), generate


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
def bring_together(_typing: Any, bits: Any, words: Any, at: Any) -> Any:
    """Make 64 words, by :data:`OF_TRAIN`, from a flat index on, of eight rows of bytes of bits."""
    vector, index = VECTORS["uint8"], ir.IntType(64)

    def generate(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        bits, words, at = arguments

        def row(group: int, unit: int) -> Any:
            first = index(group * WORD + unit * UNIT)
            return b.load(pointer(context, b, signature.args[0], bits, first, vector), align=UNIT)

        def interleave(one: Any, other: Any, numbers: list[int], bits: int) -> Any:
            which = ir.Constant(ir.VectorType(ir.IntType(32), UNIT), _bytes(numbers, bits))
            return b.shuffle_vector(one, other, which)

        for unit in (0, 1):
            rows = [row(group, unit) for group in range(BYTE)]
            for i, few in enumerate(_brought_together(rows, interleave)):
                place = b.add(at, index(unit * UNIT + i * UNIT // BYTE))
                b.store(few, pointer(context, b, signature.args[1], words, place, vector), align=8)
        return context.get_dummy_value()

    return types.void(bits, words, types.intp), generate


@inlined
def _byte(tallies: Any, end: Any) -> Any:
    """Eight samples' tallies, none of them above 1, as bits; ``end``: behind the last of them."""
    bits = no_spikes()
    for i in range(1, BYTE + 1):
        bits = pushed(bits, load(tallies, end - i * WORD, 2))
    return bits


@inlined
def _byte_above(tallies: Any, end: Any, low: Any) -> Any:
    """Whether they are above ``low``, as bits."""
    bits = no_spikes()
    for i in range(1, BYTE + 1):
        bits = pushed(bits, above(load(tallies, end - i * WORD, 2), low))
    return bits


def _keep(tallies: Any, n: Any, held: Any, word: Any) -> int:
    """Put tallies of up to 64 samples, uint8 (64 · 64,) as they are counted, into words.

    ``held``: uint64 (planes, words, 64), in the order of :data:`OF_TRAIN`; plane p tells of more
    than p spikes. Returns the largest tally, be it more than there are planes.
    """
    tallies[n * WORD :] = 0
    bits, seen = own("uint8", OF_EIGHT), no_spikes()
    for i in range(n):
        seen = more(seen, load(tallies, i * WORD, 2))
    most: int = largest(seen)
    for plane in range(held.shape[0]):
        for group in range(BYTE):
            end = (group + 1) * OF_EIGHT
            are_bits = most <= 1 and plane == 0
            of_group = _byte(tallies, end) if are_bits else _byte_above(tallies, end, plane)
            store(bits, group * WORD, of_group)
        bring_together(bits, held, (plane * held.shape[1] + word) * WORD)
    return most


def _hand_over(held: Any, n: Any, words: Any, train: Any) -> None:
    """Lay a block's first ``n`` words one behind the other, train by train.

    ``held``: as :func:`keep` fills it; ``words``: uint64 (planes, trains, words), where ``train``
    is the block's first. Both hold whole lines of the cache, and what lies behind the ``n`` words
    in the last of them means nothing.
    """
    for plane in range(words.shape[0]):
        for first in range(0, n, LINE):
            for place in range(WORD):
                for i in range(first, first + LINE):
                    words[plane, train + place, i] = held[plane, i, OF_TRAIN[place]]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
keep, hand_over = _compile(_keep), _compile(_hand_over)
