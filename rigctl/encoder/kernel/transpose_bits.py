"""Transpose the spikes of 64 samples of a block's 64 trains into one word of 64 bits a train.

Eight samples of a train are shifted bit by bit into a byte, for all trains at once; then
interleaving joins the eight bytes of each train. Words of all trains stay side by side until the
block is done, and are then transposed to train after train.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import types

from rigctl.encoder.kernel.simd import (
    HALF_LANES,
    VECTORS,
    call_llvm,
    elementwise,
    inline,
    intrinsic,
    load,
    pack,
    pointer,
    splat,
    stack_memory,
    store,
    unpack,
)
from rigctl.encoder.kernel.spike_counters import LANE_OF_BYTE, zero_counters

# Bits of a word, and trains of a block.
WORD = 2 * HALF_LANES
BYTE = 8
# Processors interleave bytes within groups of 16, half a vector.
GROUP_BYTES = HALF_LANES // 2
# Bytes of eight samples of a block, and words of a cache line.
EIGHT_SAMPLES, LINE_WORDS = BYTE * WORD, 8


def _interleaved(bits: int, upper: int) -> list[int]:
    """Return which numbers of ``bits`` bits of two vectors alternate, from half of each group."""
    n = BYTE * GROUP_BYTES // bits
    first = n // 2 if upper else 0
    return [
        v * 2 * n + group * n + first + i for group in (0, 1) for i in range(n // 2) for v in (0, 1)
    ]


def _byte_indices(numbers: list[int], bits: int) -> list[int]:
    """Return the byte indices of numbers of ``bits`` bits."""
    size = bits // BYTE
    return [size * number + i for number in numbers for i in range(size)]


def _join_bytes(vectors: list[Any], interleave: Any) -> list[Any]:
    """Turn eight vectors of bytes into eight of words: the first bytes of all, the second ones …"""
    for bits in (8, 16, 32):
        pairs = [(vectors[i], vectors[i + 1]) for i in range(0, len(vectors), 2)]
        both = [[interleave(*pair, _interleaved(bits, u), bits) for pair in pairs] for u in (0, 1)]
        vectors = [vector for half in both for vector in half]
    return vectors


def _half_byte_of_word() -> list[int]:
    """Return which counter byte of half a block each word is from, in the order of the words."""
    labels = [[(byte, row) for byte in range(HALF_LANES)] for row in range(BYTE)]

    def interleave(one: list[Any], other: list[Any], numbers: list[int], bits: int) -> list[Any]:
        return [(one + other)[i] for i in _byte_indices(numbers, bits)]

    out = [label for vector in _join_bytes(labels, interleave) for label in vector]
    return [byte for byte, row in out if row == 0]


# The index of each train's word.
_TRAIN_OF_WORD = LANE_OF_BYTE.reshape(2, HALF_LANES)[:, _half_byte_of_word()].reshape(-1)
WORD_OF_TRAIN = np.argsort(_TRAIN_OF_WORD)


@intrinsic
def _shift_in(_typing: Any, bits: Any, bit: Any) -> Any:
    """Return the bytes shifted left, with a new lowest bit, 0 or 1."""
    return elementwise(lambda b, bits, bit: b.or_(b.add(bits, bits), bit), bits, bits, bit)


@intrinsic
def _exceeds(_typing: Any, counters: Any, limit: Any) -> Any:
    """Return 1 where a counter exceeds ``limit``, else 0."""
    subtract, minimum = f"llvm.usub.sat.v{HALF_LANES}i8", f"llvm.umin.v{HALF_LANES}i8"
    vector = VECTORS["uint8"]

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        limit = splat(b, b.trunc(arguments[1], vector.element), vector)
        one = ir.Constant(vector, [1] * HALF_LANES)
        excess = [call_llvm(b, subtract, half, limit) for half in unpack(b, arguments[0])]
        return pack(b, [call_llvm(b, minimum, half, one) for half in excess])

    return counters(counters, types.intp), generate


@intrinsic
def _maximum_counters(_typing: Any, one: Any, other: Any) -> Any:
    """Return the larger counter of each train."""
    name = f"llvm.umax.v{HALF_LANES}i8"
    return elementwise(lambda b, *both: call_llvm(b, name, *both), one, one, other)


@intrinsic
def _largest(_typing: Any, counters: Any) -> Any:
    """Return the largest counter of a block."""

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        both = call_llvm(b, f"llvm.umax.v{HALF_LANES}i8", *unpack(b, arguments[0]))
        name, byte = f"llvm.vector.reduce.umax.v{HALF_LANES}i8", ir.IntType(8)
        function = b.module.globals.get(name) or ir.Function(
            b.module, ir.FunctionType(byte, [both.type]), name
        )
        return b.zext(b.call(function, [both]), ir.IntType(64))

    return types.intp(counters), generate


@intrinsic
def _store_words(_typing: Any, bits: Any, words: Any, at: Any) -> Any:
    """Join eight rows of bytes of bits to 64 words, by :data:`WORD_OF_TRAIN`, from an index on."""
    vector, index = VECTORS["uint8"], ir.IntType(64)

    def generate(context: Any, b: Any, signature: Any, arguments: Any) -> Any:
        bits, words, at = arguments

        def load_row(row: int, half: int) -> Any:
            first = index(row * WORD + half * HALF_LANES)
            source = pointer(context, b, signature.args[0], bits, first, vector)
            return b.load(source, align=HALF_LANES)

        def interleave(one: Any, other: Any, numbers: list[int], bits: int) -> Any:
            places = _byte_indices(numbers, bits)
            return b.shuffle_vector(
                one, other, ir.Constant(ir.VectorType(ir.IntType(32), HALF_LANES), places)
            )

        for half in (0, 1):
            rows = [load_row(row, half) for row in range(BYTE)]
            for i, few in enumerate(_join_bytes(rows, interleave)):
                place = b.add(at, index(half * HALF_LANES + i * HALF_LANES // BYTE))
                b.store(few, pointer(context, b, signature.args[1], words, place, vector), align=8)
        return context.get_dummy_value()

    return types.void(bits, words, types.intp), generate


@inline
def _pack_byte(counters: Any, end: Any, limit: Any) -> Any:
    """Pack into bits whether eight samples' counters exceed ``limit``; ``end``: behind the last."""
    bits = zero_counters()
    for i in range(1, BYTE + 1):
        bits = _shift_in(bits, _exceeds(load(counters, end - i * WORD, 2), limit))
    return bits


def _pack_words(counters: Any, n: Any, packed: Any, word: Any) -> int:
    """Pack the counters of up to 64 samples, uint8 (64 · 64,), into words.

    ``packed``: uint64 (planes, words, 64), in the order of :data:`WORD_OF_TRAIN`; a bit of plane p
    means more than p spikes. Returns the largest counter, even if it exceeds the planes.
    """
    counters[n * WORD :] = 0
    bits, maxima = stack_memory("uint8", EIGHT_SAMPLES), zero_counters()
    for i in range(n):
        maxima = _maximum_counters(maxima, load(counters, i * WORD, 2))
    highest: int = _largest(maxima)
    for plane in range(packed.shape[0]):
        for row in range(BYTE):
            store(bits, row * WORD, _pack_byte(counters, (row + 1) * EIGHT_SAMPLES, plane))
        _store_words(bits, packed, (plane * packed.shape[1] + word) * WORD)
    return highest


def _transpose_words(packed: Any, n: Any, words: Any, train: Any) -> None:
    """Transpose a block's first ``n`` words of each train to train after train.

    ``packed``: from :func:`pack_words`; ``words``: uint64 (planes, trains, words), where ``train``
    is the block's first. Both hold whole cache lines; what is behind the ``n`` words in the last
    line is undefined.
    """
    for plane in range(words.shape[0]):
        for first in range(0, n, LINE_WORDS):
            for i in range(WORD):
                for word in range(first, first + LINE_WORDS):
                    words[plane, train + i, word] = packed[plane, word, WORD_OF_TRAIN[i]]


_compile = numba.njit(cache=True, nogil=True, error_model="numpy")
pack_words, transpose_words = _compile(_pack_words), _compile(_transpose_words)
