"""Numbers of neighbouring lanes in compiled code: vectors of a fixed width, and what they can do.

Written with vectors, nothing is left to a compiler's guess at what may be vectorised. On a
processor with narrower registers LLVM splits them; the operations, each of them rounded as IEEE 754
says, stay the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, codegen, types
from numba.extending import intrinsic, models, register_model

Function = Callable[..., Any]


def _has(feature: str) -> bool:
    """Whether the processor that numba compiles for has it."""
    config, host = cast(Any, numba.config), cast(Any, codegen)
    told = config.CPU_FEATURES
    features = host.get_host_cpu_features() if told is None else told
    return f"+{feature}" in features.split(",")


# Whether there are registers of four numbers, and of eight with masks for choices.
AVX2, MASKED = _has("avx2"), _has("avx512f")
WIDE = 8 if MASKED else 4

# Lanes whose bytes are one vector.
UNIT = 32
IN_UNIT = UNIT // WIDE

VECTORS = {
    "float64": ir.VectorType(ir.DoubleType(), WIDE),
    "uint16": ir.VectorType(ir.IntType(16), WIDE),
    "uint8": ir.VectorType(ir.IntType(8), UNIT),
}
FMA = f"llvm.fma.v{WIDE}f64"
CACHE_LINE = 64


class Lanes(types.Type):
    """In compiled code: numbers of neighbouring lanes, in so many vectors."""

    def __init__(self, element: str, vectors: int) -> None:
        super().__init__(f"Lanes({element}, {vectors})")
        self.element, self.vectors = element, vectors


class Own(types.Type):
    """In compiled code: memory of a function's own, on its stack, no vector in two cache lines."""

    def __init__(self, element: str) -> None:
        super().__init__(f"Own({element})")
        self.element = self.dtype = element


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        vectors = ir.ArrayType(VECTORS[kind.element], kind.vectors)
        super().__init__(manager, kind, vectors)  # type: ignore[no-untyped-call]  # numba is untyped here


@register_model(Own)
class _OwnModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Own) -> None:
        place = VECTORS[kind.element].element.as_pointer()
        super().__init__(manager, kind, place)  # type: ignore[no-untyped-call]  # as above


def emitted(function: Function) -> Function:
    """What compiled code calls without the first parameter; it returns types and a generator."""
    compiled: Function = intrinsic(function)
    return compiled


def emitted_for(function: Function) -> Function:
    """The same for a function that needs the value of a constant argument."""
    compiled: Function = intrinsic(prefer_literal=True)(function)
    return compiled


def parts(builder: Any, value: Any) -> list[Any]:
    return [builder.extract_value(value, i) for i in range(value.type.count)]


def whole(builder: Any, vectors: list[Any]) -> Any:
    value = ir.Constant(ir.ArrayType(vectors[0].type, len(vectors)), ir.Undefined)
    for i, vector in enumerate(vectors):
        value = builder.insert_value(value, vector, i)
    return value


def joined(b: Any, vectors: list[Any]) -> Any:
    """Vectors of the same length, a power of two of them, as one."""
    while len(vectors) > 1:
        n = vectors[0].type.count
        all_ = ir.Constant(ir.VectorType(ir.IntType(32), 2 * n), list(range(2 * n)))
        pairs = zip(vectors[::2], vectors[1::2], strict=True)
        vectors = [b.shuffle_vector(*pair, all_) for pair in pairs]
    return vectors[0]


def call(builder: Any, name: str, *arguments: Any) -> Any:
    kind = arguments[0].type
    signature = ir.FunctionType(kind, [kind] * len(arguments))
    get: Any = cgutils.get_or_insert_function
    return builder.call(get(builder.module, signature, name), arguments)


def elementwise(operation: Callable[..., Any], result: Lanes, *operands: Lanes) -> Any:
    """An intrinsic that applies ``operation(builder, *vectors)`` to each vector."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        columns = zip(*(parts(builder, value) for value in arguments), strict=True)
        return whole(builder, [operation(builder, *vectors) for vectors in columns])

    return result(*operands), generate


@emitted_for
def own(_typing: Any, element: Any, numbers: Any) -> Any:
    """Memory for so many numbers."""
    kind, size = Own(element.literal_value), numbers.literal_value

    def generate(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        number = VECTORS[kind.element].element
        allocate: Any = cgutils.alloca_once
        place = allocate(builder, ir.ArrayType(number, size))
        place.align = CACHE_LINE
        return builder.bitcast(place, number.as_pointer())

    return kind(element, numbers), generate


def pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    """Where in memory a vector lies in a contiguous array, from a flat index on."""
    is_own = isinstance(kind, Own)
    data = array if is_own else context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def places_of(
    context: Any, builder: Any, kind: Any, array: Any, index: Any, lanes: Lanes
) -> tuple[list[Any], int]:
    """Pointers to vectors in an array, from a flat index on, and how they are aligned in bytes."""
    vector = VECTORS[lanes.element]
    steps = [ir.Constant(index.type, vector.count * i) for i in range(lanes.vectors)]
    indices = [builder.add(index, step) for step in steps]
    size = np.dtype(lanes.element).itemsize
    align = size * vector.count if isinstance(kind, Own) else size
    return [pointer(context, builder, kind, array, i, vector) for i in indices], align


@emitted_for
def load(_typing: Any, array: Any, index: Any, vectors: Any) -> Any:
    """So many vectors from a contiguous array, from a flat index on."""
    kind = Lanes(str(array.dtype), vectors.literal_value)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        places, align = places_of(context, builder, array, arguments[0], arguments[1], kind)
        return whole(builder, [builder.load(place, align=align) for place in places])

    return kind(array, types.intp, vectors), generate


@emitted
def store(_typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write vectors into a contiguous array, from a flat index on."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        places, align = places_of(context, builder, array, arguments[0], arguments[1], value)
        for place, part in zip(places, parts(builder, arguments[2]), strict=True):
            builder.store(part, place, align=align)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


def splat(builder: Any, number: Any, vector: Any) -> Any:
    """A vector that holds the same number throughout."""
    empty, place = ir.Constant(vector, ir.Undefined), ir.IntType(32)
    one = builder.insert_element(empty, number, place(0))
    firsts = ir.Constant(ir.VectorType(place, vector.count), None)
    return builder.shuffle_vector(one, empty, firsts)


@emitted_for
def full(_typing: Any, number: Any, vectors: Any) -> Any:
    """The same number in all lanes."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        same = splat(builder, arguments[0], VECTORS["float64"])
        return whole(builder, [same] * vectors.literal_value)

    return Lanes("float64", vectors.literal_value)(types.float64, vectors), generate


@emitted
def fma(_typing: Any, x: Any, y: Any, z: Any) -> Any:
    """x · y + z, rounded once."""
    return elementwise(lambda b, *xyz: call(b, FMA, *xyz), x, x, y, z)


@emitted
def add(_typing: Any, x: Any, y: Any) -> Any:
    """x + y."""
    return elementwise(lambda b, *xy: b.fadd(*xy), x, x, y)


@emitted
def sub(_typing: Any, x: Any, y: Any) -> Any:
    """x − y."""
    return elementwise(lambda b, *xy: b.fsub(*xy), x, x, y)


@emitted
def mul(_typing: Any, x: Any, y: Any) -> Any:
    """x · y."""
    return elementwise(lambda b, *xy: b.fmul(*xy), x, x, y)


@emitted
def larger(_typing: Any, x: Any, y: Any) -> Any:
    """x where it is above y, else y."""
    return elementwise(lambda b, x, y: b.select(b.fcmp_ordered(">", x, y), x, y), x, x, y)


@emitted
def reached(_typing: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
    """``then`` in the lanes in which the value has reached the threshold, else ``otherwise``."""

    def choose(b: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
        return b.select(b.fcmp_ordered(">=", value, threshold), then, otherwise)

    return elementwise(choose, value, value, threshold, then, otherwise)


@emitted
def within(_typing: Any, reading: Any, low: Any, width: Any) -> Any:
    """How far the reading lies above the low end, as a real number from 0 to the width."""
    n = WIDE * reading.vectors
    above, least = f"llvm.usub.sat.v{n}i16", f"llvm.umin.v{n}i16"

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        reading, low, width = (joined(b, parts(b, each)) for each in arguments)
        cut = call(b, least, call(b, above, reading, low), width)
        return whole(b, [_reals(b, cut, first) for first in range(0, n, WIDE)])

    return Lanes("float64", reading.vectors)(reading, low, width), generate


def _reals(b: Any, numbers: Any, first: int) -> Any:
    """A vector of some of the numbers of 16 bits, from the first on.

    Interleaved with zeros they are numbers of 32 bits: one operation, where widening and taking
    apart are three.
    """
    index, zeros = ir.VectorType(ir.IntType(32), 2 * WIDE), ir.Constant(numbers.type, None)
    places = [place for i in range(first, first + WIDE) for place in (i, numbers.type.count)]
    both = b.shuffle_vector(numbers, zeros, ir.Constant(index, places))
    whole_numbers = b.bitcast(both, ir.VectorType(ir.IntType(32), WIDE))
    return b.sitofp(whole_numbers, VECTORS["float64"])


def inlined(function: Function) -> Function:
    """Compiled into whatever calls it: a call would send all registers through memory."""
    compiled: Function = numba.njit(forceinline=True, error_model="numpy")(function)
    return compiled
