"""Spike counters of the 32 lanes of half a block: one byte a lane, together one vector.

A comparison of float64 gives a mask of 64 bits a lane, one register for four lanes; counters of
that size would take half as much memory as the neurons. Blending packs eight such masks into one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir

from rigctl.encoder.kernel.simd import (
    HALF_LANES,
    HALF_VECTORS,
    HAS_AVX2,
    HAS_AVX512,
    VECTOR_WIDTH,
    VECTORS,
    Function,
    Lanes,
    concatenate,
    elementwise,
    intrinsic,
    pack,
    unpack,
)

# The lane of each counter byte, for half a block and for both halves.
_HALF_LANE_OF_BYTE = [
    i if HAS_AVX512 else VECTOR_WIDTH * (i % HALF_VECTORS) + i // HALF_VECTORS
    for i in range(HALF_LANES)
]
LANE_OF_BYTE = np.array(
    [first + lane for first in (0, HALF_LANES) for lane in _HALF_LANE_OF_BYTE], np.int64
)


def _pin(b: Any, value: Any) -> Any:
    """Return the value, computed here: computed later, its operands would occupy registers."""
    if not HAS_AVX2:
        return value
    kind = ir.FunctionType(value.type, [value.type])
    return b.call(ir.InlineAsm(kind, "", "=x,0", side_effect=True), [value])


def _blend(b: Any, even: Any, odd: Any, bits: int) -> Any:
    """Return ``bits``-bit numbers of ``even`` at even positions, of ``odd`` at odd ones."""
    kind = ir.VectorType(ir.IntType(bits), HALF_LANES * 8 // bits)
    places = [i + kind.count * (i % 2) for i in range(kind.count)]
    indices = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), places)
    blended = _pin(b, b.shuffle_vector(b.bitcast(even, kind), b.bitcast(odd, kind), indices))
    return b.bitcast(blended, VECTORS["uint8"])


def vector_order(first: int = 0, step: int = 1) -> list[int]:
    """Return the vectors of half a block in the order in which :func:`pack_masks` needs them."""
    if HAS_AVX512:
        return list(range(HALF_VECTORS))
    if step == HALF_VECTORS:
        return [first]
    return vector_order(first, 2 * step) + vector_order(first + step, 2 * step)


def pack_masks(b: Any, emit_mask: Function, first: int = 0, step: int = 1) -> Any:
    """Return the spikes of half a block as bytes, −1 each.

    ``emit_mask(i)`` emits the mask of vector i, called in :func:`vector_order`. With mask
    registers the bytes are in the order of the lanes. Without, a mask has 64 bits a lane, and
    eight masks are blended: lane j of vector i becomes byte 8j + i.
    """
    if HAS_AVX512:
        return b.sext(concatenate(b, [emit_mask(i) for i in vector_order()]), VECTORS["uint8"])
    if step == HALF_VECTORS:
        return b.sext(emit_mask(first), ir.VectorType(ir.IntType(64), VECTOR_WIDTH))
    even, odd = (pack_masks(b, emit_mask, i, 2 * step) for i in (first, first + step))
    return _blend(b, even, odd, 8 * step)


@intrinsic
def to_lane_order(_typing: Any, counters: Any) -> Any:
    """Return the counters of a block in the order of the lanes."""
    places = [_HALF_LANE_OF_BYTE.index(lane) for lane in range(HALF_LANES)]

    def reorder(b: Any, half: Any) -> Any:
        indices = ir.Constant(ir.VectorType(ir.IntType(32), HALF_LANES), places)
        return b.shuffle_vector(half, half, indices)

    return elementwise(reorder, counters, counters)


@intrinsic
def zero_counters(_typing: Any) -> Any:
    """Return the counters of a block, all 0."""
    zero = ir.Constant(VECTORS["uint8"], None)
    return Lanes("uint8", 2)(), lambda _c, b, _s, _a: pack(b, [zero, zero])


@intrinsic
def add_spikes(_typing: Any, counters: Any, spikes: Any) -> Any:
    """Return the counters plus one for each spike; a spike is −1."""
    return elementwise(lambda b, *both: b.sub(*both), counters, counters, spikes)


@intrinsic
def half_spikes(_typing: Any, value: Any, threshold: Any) -> Any:
    """Return the spikes of half a block: −1 where the value reached the threshold."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pairs = list(zip(*(unpack(builder, each) for each in arguments), strict=True))
        masks = pack_masks(builder, lambda i: builder.fcmp_ordered(">=", *pairs[i]))
        return pack(builder, [masks])

    return Lanes("uint8", 1)(value, threshold), generate


@intrinsic
def join_halves(_typing: Any, one: Any, other: Any) -> Any:
    """Return the spikes of both halves of a block."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return pack(builder, [unpack(builder, half)[0] for half in arguments])

    return Lanes("uint8", 2)(one, other), generate
