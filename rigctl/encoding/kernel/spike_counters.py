"""Spikes of 32 lanes as a vector of bytes, and tallies of them.

A comparison of float64 gives 64 bits a lane, one register for four lanes; so kept, counts would
take half as much memory as the neurons. Blended into one another, eight such are one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir

from rigctl.encoding.kernel.simd import (
    AVX2,
    IN_UNIT,
    MASKED,
    UNIT,
    VECTORS,
    WIDE,
    Lanes,
    elementwise,
    emitted,
    joined,
    parts,
    whole,
)

# The lane of each byte of a tally, of two units one behind the other.
_IN_UNIT = [i if MASKED else WIDE * (i % IN_UNIT) + i // IN_UNIT for i in range(UNIT)]
PLACES = np.array([*_IN_UNIT, *(UNIT + i for i in _IN_UNIT)], np.int64)


def _pinned(b: Any, value: Any) -> Any:
    """The same, computed here and not later, while what it is made of would wait in registers."""
    if not AVX2:
        return value
    kind = ir.FunctionType(value.type, [value.type])
    return b.call(ir.InlineAsm(kind, "", "=x,0", side_effect=True), [value])


def _blended(b: Any, one: Any, other: Any, bits: int) -> Any:
    """Numbers of so many bits: of the one vector at even places, of the other at odd ones."""
    kind = ir.VectorType(ir.IntType(bits), UNIT * 8 // bits)
    places = [i + kind.count * (i % 2) for i in range(kind.count)]
    which = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), places)
    blended = _pinned(b, b.shuffle_vector(b.bitcast(one, kind), b.bitcast(other, kind), which))
    return b.bitcast(blended, VECTORS["uint8"])


def in_turn(first: int = 0, step: int = 1) -> list[int]:
    """The vectors of a unit in the order in which their masks are laid into one."""
    if MASKED:
        return list(range(IN_UNIT))
    if step == IN_UNIT:
        return [first]
    return in_turn(first, 2 * step) + in_turn(first + step, 2 * step)


def collected(b: Any, spiking: Callable[[int], Any], first: int = 0, step: int = 1) -> Any:
    """Spikes of a unit, −1 each, by a function that emits those of a vector, :func:`in_turn`.

    Where masks have registers of their own, in the order of the lanes. Elsewhere a vector's mask
    has 64 bits a lane, and eight of them are laid into one: lane j of vector i becomes byte 8j + i.
    """
    if MASKED:
        return b.sext(joined(b, [spiking(i) for i in in_turn()]), VECTORS["uint8"])
    if step == IN_UNIT:
        return b.sext(spiking(first), ir.VectorType(ir.IntType(64), WIDE))
    one, other = (collected(b, spiking, i, 2 * step) for i in (first, first + step))
    return _blended(b, one, other, 8 * step)


@emitted
def in_order(_typing: Any, tally: Any) -> Any:
    """A tally in the order of the lanes."""
    places = [_IN_UNIT.index(lane) for lane in range(UNIT)]

    def ordered(b: Any, tally: Any) -> Any:
        which = ir.Constant(ir.VectorType(ir.IntType(32), UNIT), places)
        return b.shuffle_vector(tally, tally, which)

    return elementwise(ordered, tally, tally)


@emitted
def no_spikes(_typing: Any) -> Any:
    """A block's tally of nothing."""
    none = ir.Constant(VECTORS["uint8"], None)
    return Lanes("uint8", 2)(), lambda _c, b, _s, _a: whole(b, [none, none])


@emitted
def counted(_typing: Any, tally: Any, spikes: Any) -> Any:
    """A tally with one more for each spike."""
    return elementwise(lambda b, *both: b.sub(*both), tally, tally, spikes)


@emitted
def spiking(_typing: Any, value: Any, threshold: Any) -> Any:
    """The lanes of a unit that have reached the threshold."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pairs = list(zip(*(parts(builder, each) for each in arguments), strict=True))
        return whole(builder, [collected(builder, lambda i: builder.fcmp_ordered(">=", *pairs[i]))])

    return Lanes("uint8", 1)(value, threshold), generate


@emitted
def of_block(_typing: Any, one: Any, other: Any) -> Any:
    """Spikes of both units of a block."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return whole(builder, [parts(builder, unit)[0] for unit in arguments])

    return Lanes("uint8", 2)(one, other), generate
