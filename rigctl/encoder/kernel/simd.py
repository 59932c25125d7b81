"""SIMD lanes in compiled code: fixed-width vectors of neighbouring lanes, and their operations.

Explicit vectors leave nothing to a compiler's guess at what it can vectorise. On a processor with
narrower registers LLVM splits them; the operations stay the same, each rounded as IEEE 754 says.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from llvmlite import ir
from numba import extending
from numba.core import cgutils, codegen, types

Function = Callable[..., Any]


def _has(feature: str) -> bool:
    """Return whether the processor that numba compiles for has a feature."""
    config, host = cast(Any, numba.config), cast(Any, codegen)
    configured = config.CPU_FEATURES
    features = host.get_host_cpu_features() if configured is None else configured
    return f"+{feature}" in features.split(",")


# AVX2 has registers of four float64, AVX-512 of eight, with mask registers.
HAS_AVX2, HAS_AVX512 = _has("avx2"), _has("avx512f")
VECTOR_WIDTH = 8 if HAS_AVX512 else 4

# Lanes of half a block: their spike counters, one byte each, are one vector.
HALF_LANES = 32
HALF_VECTORS = HALF_LANES // VECTOR_WIDTH

VECTORS = {
    "float64": ir.VectorType(ir.DoubleType(), VECTOR_WIDTH),
    "uint16": ir.VectorType(ir.IntType(16), VECTOR_WIDTH),
    "uint8": ir.VectorType(ir.IntType(8), HALF_LANES),
}
FMA = f"llvm.fma.v{VECTOR_WIDTH}f64"
CACHE_LINE_BYTES = 64


class Lanes(types.Type):
    """Compiled code's type of the numbers of neighbouring lanes, in ``vectors`` vectors."""

    def __init__(self, element: str, vectors: int) -> None:
        super().__init__(f"Lanes({element}, {vectors})")
        self.element, self.vectors = element, vectors


class StackMemory(types.Type):
    """Compiled code's type of memory on a function's stack; no vector crosses a cache line."""

    def __init__(self, element: str) -> None:
        super().__init__(f"StackMemory({element})")
        self.element = self.dtype = element


@extending.register_model(Lanes)
class _LanesModel(extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        vectors = ir.ArrayType(VECTORS[kind.element], kind.vectors)
        super().__init__(manager, kind, vectors)  # type: ignore[no-untyped-call]  # numba annotates no constructor


@extending.register_model(StackMemory)
class _StackMemoryModel(extending.models.PrimitiveModel):
    def __init__(self, manager: Any, kind: StackMemory) -> None:
        address = VECTORS[kind.element].element.as_pointer()
        super().__init__(manager, kind, address)  # type: ignore[no-untyped-call]  # as above


def intrinsic(function: Function) -> Function:
    """Make a function for compiled code, without the first parameter, from a typed LLVM generator.

    ``function`` returns the signature and the generator.
    """
    compiled: Function = extending.intrinsic(function)
    return compiled


def literal_intrinsic(function: Function) -> Function:
    """Make the same from a function that needs the value of a constant argument."""
    compiled: Function = extending.intrinsic(prefer_literal=True)(function)
    return compiled


def inline(function: Function) -> Function:
    """Compile a function into its callers: a call would send all registers through memory."""
    compiled: Function = numba.njit(forceinline=True, error_model="numpy")(function)
    return compiled


def unpack(builder: Any, value: Any) -> list[Any]:
    """Return the vectors of a Lanes value."""
    return [builder.extract_value(value, i) for i in range(value.type.count)]


def pack(builder: Any, vectors: list[Any]) -> Any:
    """Return a Lanes value of these vectors."""
    value = ir.Constant(ir.ArrayType(vectors[0].type, len(vectors)), ir.Undefined)
    for i, vector in enumerate(vectors):
        value = builder.insert_value(value, vector, i)
    return value


def concatenate(b: Any, vectors: list[Any]) -> Any:
    """Join vectors of the same length, a power of two of them, into one."""
    while len(vectors) > 1:
        n = vectors[0].type.count
        indices = ir.Constant(ir.VectorType(ir.IntType(32), 2 * n), list(range(2 * n)))
        pairs = zip(vectors[::2], vectors[1::2], strict=True)
        vectors = [b.shuffle_vector(*pair, indices) for pair in pairs]
    return vectors[0]


def splat(builder: Any, number: Any, vector: Any) -> Any:
    """Return a vector that repeats a number."""
    empty, index = ir.Constant(vector, ir.Undefined), ir.IntType(32)
    one = builder.insert_element(empty, number, index(0))
    zeros = ir.Constant(ir.VectorType(index, vector.count), None)
    return builder.shuffle_vector(one, empty, zeros)


def call_llvm(builder: Any, name: str, *arguments: Any) -> Any:
    """Call an LLVM intrinsic whose arguments and result have the same type."""
    kind = arguments[0].type
    signature = ir.FunctionType(kind, [kind] * len(arguments))
    get: Any = cgutils.get_or_insert_function
    return builder.call(get(builder.module, signature, name), arguments)


def elementwise(operation: Function, result: Lanes, *operands: Lanes) -> Any:
    """Define an intrinsic that applies ``operation(builder, *vectors)`` to each vector."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        columns = zip(*(unpack(builder, value) for value in arguments), strict=True)
        return pack(builder, [operation(builder, *vectors) for vectors in columns])

    return result(*operands), generate


@literal_intrinsic
def stack_memory(_typing: Any, element: Any, size: Any) -> Any:
    """Allocate memory for ``size`` numbers."""
    kind, n = StackMemory(element.literal_value), size.literal_value

    def generate(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        number = VECTORS[kind.element].element
        allocate: Any = cgutils.alloca_once
        memory = allocate(builder, ir.ArrayType(number, n))
        memory.align = CACHE_LINE_BYTES
        return builder.bitcast(memory, number.as_pointer())

    return kind(element, size), generate


def pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    """Return the pointer to a vector at a flat index of a contiguous array."""
    on_stack = isinstance(kind, StackMemory)
    data = array if on_stack else context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def vector_pointers(
    context: Any, builder: Any, kind: Any, array: Any, index: Any, lanes: Lanes
) -> tuple[list[Any], int]:
    """Return pointers to vectors from a flat index of an array, and their alignment in bytes."""
    vector = VECTORS[lanes.element]
    steps = [ir.Constant(index.type, vector.count * i) for i in range(lanes.vectors)]
    indices = [builder.add(index, step) for step in steps]
    size = np.dtype(lanes.element).itemsize
    align = size * vector.count if isinstance(kind, StackMemory) else size
    return [pointer(context, builder, kind, array, i, vector) for i in indices], align


@literal_intrinsic
def load(_typing: Any, array: Any, index: Any, vectors: Any) -> Any:
    """Load ``vectors`` vectors from a flat index of a contiguous array."""
    kind = Lanes(str(array.dtype), vectors.literal_value)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointers, align = vector_pointers(context, builder, array, arguments[0], arguments[1], kind)
        return pack(builder, [builder.load(each, align=align) for each in pointers])

    return kind(array, types.intp, vectors), generate


@intrinsic
def store(_typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Store vectors from a flat index of a contiguous array."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointers, align = vector_pointers(
            context, builder, array, arguments[0], arguments[1], value
        )
        for each, vector in zip(pointers, unpack(builder, arguments[2]), strict=True):
            builder.store(vector, each, align=align)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


@literal_intrinsic
def broadcast(_typing: Any, number: Any, vectors: Any) -> Any:
    """Return the same number in all lanes."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        vector = splat(builder, arguments[0], VECTORS["float64"])
        return pack(builder, [vector] * vectors.literal_value)

    return Lanes("float64", vectors.literal_value)(types.float64, vectors), generate


@intrinsic
def fma(_typing: Any, x: Any, y: Any, z: Any) -> Any:
    """Return x · y + z, rounded once."""
    return elementwise(lambda b, *xyz: call_llvm(b, FMA, *xyz), x, x, y, z)


@intrinsic
def add(_typing: Any, x: Any, y: Any) -> Any:
    """Return x + y."""
    return elementwise(lambda b, *xy: b.fadd(*xy), x, x, y)


@intrinsic
def sub(_typing: Any, x: Any, y: Any) -> Any:
    """Return x − y."""
    return elementwise(lambda b, *xy: b.fsub(*xy), x, x, y)


@intrinsic
def mul(_typing: Any, x: Any, y: Any) -> Any:
    """Return x · y."""
    return elementwise(lambda b, *xy: b.fmul(*xy), x, x, y)


@intrinsic
def maximum(_typing: Any, x: Any, y: Any) -> Any:
    """Return x where it is above y, else y."""
    return elementwise(lambda b, x, y: b.select(b.fcmp_ordered(">", x, y), x, y), x, x, y)


@intrinsic
def select_reached(_typing: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
    """Return ``then`` in the lanes in which the value reached the threshold, else ``otherwise``."""

    def select(b: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
        return b.select(b.fcmp_ordered(">=", value, threshold), then, otherwise)

    return elementwise(select, value, value, threshold, then, otherwise)


@intrinsic
def clip_to_range(_typing: Any, reading: Any, low: Any, width: Any) -> Any:
    """Return how far a uint16 reading is above the low end, as float64 from 0 to the width."""
    n = VECTOR_WIDTH * reading.vectors
    subtract, minimum = f"llvm.usub.sat.v{n}i16", f"llvm.umin.v{n}i16"

    def generate(_context: Any, b: Any, _signature: Any, arguments: Any) -> Any:
        reading, low, width = (concatenate(b, unpack(b, each)) for each in arguments)
        clipped = call_llvm(b, minimum, call_llvm(b, subtract, reading, low), width)
        return pack(b, [_to_float64(b, clipped, first) for first in range(0, n, VECTOR_WIDTH)])

    return Lanes("float64", reading.vectors)(reading, low, width), generate


def _to_float64(b: Any, numbers: Any, first: int) -> Any:
    """Return a vector of some of the uint16 numbers, from ``first`` on, as float64."""
    lanes = list(range(first, first + VECTOR_WIDTH))
    indices = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR_WIDTH), lanes)
    return b.uitofp(b.shuffle_vector(numbers, numbers, indices), VECTORS["float64"])
