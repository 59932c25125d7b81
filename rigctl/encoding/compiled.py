"""The kernel in machine code: dozens of neurons at a time, their state in registers throughout.

The inner loop is written with vectors of a fixed width, so nothing is left to a compiler's guess
at what may be vectorised. On a processor with narrower registers LLVM splits them; the operations,
each of them rounded as IEEE 754 says, stay the same, so the spikes do. Types and kernel share this
file because numba's disk cache looks at the age of the kernel's own file only.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

Kernel = Callable[..., None]
Function = Callable[..., Any]

# Several vectors of eight hide each other's latency, until they run out of registers: of each four
# SA and four RA at a time, or six where SA is alone.
WIDE = 8
VECTORS, VECTORS_OF_SA = 4, 6
LANES, LANES_OF_SA = WIDE * VECTORS, WIDE * VECTORS_OF_SA

# Rows of the state: membrane and recovery of SA and RA, and the RA channel's filter.
M, Q, M_RA, Q_RA, Z1, Z2, LAST = range(7)
STATE_ROWS = 7

# Positions in the vector of folded constants.
W0, KEEP, TAKE, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING, FALL = range(11, 20)
N_CONSTANTS = 20

_VECTORS = {
    "float64": ir.VectorType(ir.DoubleType(), WIDE),
    "uint16": ir.VectorType(ir.IntType(16), WIDE),
    "uint8": ir.VectorType(ir.IntType(8), WIDE),
}


class Lanes(types.Type):
    """In compiled code: one number of every lane of a block."""

    def __init__(self, element: str, vectors: int) -> None:
        super().__init__(f"Lanes({element}, {vectors})")
        self.element, self.vectors = element, vectors


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        vectors = ir.ArrayType(_VECTORS[kind.element], kind.vectors)
        super().__init__(manager, kind, vectors)  # type: ignore[no-untyped-call]  # numba is untyped here


def emitted(function: Function) -> Function:
    """What compiled code calls without the first parameter; it returns types and a generator."""
    compiled: Function = intrinsic(function)
    return compiled


def _emitted_for(function: Function) -> Function:
    """The same for a function that needs the value of a constant argument."""
    compiled: Function = intrinsic(prefer_literal=True)(function)
    return compiled


def _parts(builder: Any, value: Any) -> list[Any]:
    return [builder.extract_value(value, i) for i in range(value.type.count)]


def _whole(builder: Any, parts: list[Any]) -> Any:
    value = ir.Constant(ir.ArrayType(parts[0].type, len(parts)), ir.Undefined)
    for i, part in enumerate(parts):
        value = builder.insert_value(value, part, i)
    return value


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    kind = arguments[0].type
    signature = ir.FunctionType(kind, [kind] * len(arguments))
    get: Any = cgutils.get_or_insert_function
    return builder.call(get(builder.module, signature, name), arguments)


def _elementwise(operation: Callable[..., Any], result: Lanes, *operands: Lanes) -> Any:
    """An intrinsic that applies ``operation(builder, *vectors)`` to each vector of a block."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        columns = zip(*(_parts(builder, value) for value in arguments), strict=True)
        return _whole(builder, [operation(builder, *vectors) for vectors in columns])

    return result(*operands), generate


def pointer(context: Any, builder: Any, kind: Any, array: Any, index: Any, vector: Any) -> Any:
    """Where in memory a vector lies in a contiguous array, from a flat index on."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _places(context: Any, builder: Any, signature: Any, arguments: Any, lanes: Lanes) -> list[Any]:
    """Pointers to a block's vectors in the array that comes first, from the index after it."""
    vector = _VECTORS[lanes.element]
    steps = [ir.Constant(arguments[1].type, WIDE * i) for i in range(lanes.vectors)]
    indices = [builder.add(arguments[1], step) for step in steps]
    kind, array = signature.args[0], arguments[0]
    return [pointer(context, builder, kind, array, i, vector) for i in indices]


@_emitted_for
def load(_typing: Any, array: Any, index: Any, vectors: Any) -> Any:
    """A block's numbers from a contiguous array, from a flat index on."""
    kind = Lanes(str(array.dtype), vectors.literal_value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(context, builder, signature, arguments, kind)
        size = array.dtype.bitwidth // 8
        return _whole(builder, [builder.load(place, align=size) for place in places])

    return kind(array, types.intp, vectors), generate


@emitted
def store(_typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write a block's numbers into a contiguous array, from a flat index on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(context, builder, signature, arguments, value)
        for place, part in zip(places, _parts(builder, arguments[2]), strict=True):
            builder.store(part, place, align=array.dtype.bitwidth // 8)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


@_emitted_for
def full(_typing: Any, number: Any, vectors: Any) -> Any:
    """The same number in all lanes."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        empty = ir.Constant(_VECTORS["float64"], ir.Undefined)
        one = builder.insert_element(empty, arguments[0], ir.Constant(ir.IntType(32), 0))
        first = ir.Constant(ir.VectorType(ir.IntType(32), WIDE), [0] * WIDE)
        same = builder.shuffle_vector(one, empty, first)
        return _whole(builder, [same] * vectors.literal_value)

    return Lanes("float64", vectors.literal_value)(types.float64, vectors), generate


@emitted
def as_bytes(_typing: Any, tally: Any) -> Any:
    """A tally in bytes."""
    return _elementwise(
        lambda b, tally: b.fptoui(tally, _VECTORS["uint8"]), Lanes("uint8", tally.vectors), tally
    )


@emitted
def fma(_typing: Any, x: Any, y: Any, z: Any) -> Any:
    """x · y + z, rounded once."""
    name = f"llvm.fma.v{WIDE}f64"
    return _elementwise(lambda b, *xyz: _call(b, name, *xyz), x, x, y, z)


@emitted
def add(_typing: Any, x: Any, y: Any) -> Any:
    """x + y."""
    return _elementwise(lambda b, *xy: b.fadd(*xy), x, x, y)


@emitted
def sub(_typing: Any, x: Any, y: Any) -> Any:
    """x − y."""
    return _elementwise(lambda b, *xy: b.fsub(*xy), x, x, y)


@emitted
def mul(_typing: Any, x: Any, y: Any) -> Any:
    """x · y."""
    return _elementwise(lambda b, *xy: b.fmul(*xy), x, x, y)


@emitted
def larger(_typing: Any, x: Any, y: Any) -> Any:
    """x where it is above y, else y."""
    return _elementwise(lambda b, x, y: b.select(b.fcmp_ordered(">", x, y), x, y), x, x, y)


@emitted
def reached(_typing: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
    """``then`` in the lanes in which the value has reached the threshold, else ``otherwise``."""

    def choose(b: Any, value: Any, threshold: Any, then: Any, otherwise: Any) -> Any:
        return b.select(b.fcmp_ordered(">=", value, threshold), then, otherwise)

    return _elementwise(choose, value, value, threshold, then, otherwise)


@emitted
def tallied(_typing: Any, tally: Any, value: Any, threshold: Any) -> Any:
    """The tally, one higher in the lanes in which the value has reached the threshold.

    A real number, as the other lanes are: to choose it takes one step, to turn a choice into a
    byte and add that two.
    """
    one = ir.Constant(_VECTORS["float64"], [1.0] * WIDE)

    def count(b: Any, tally: Any, value: Any, threshold: Any) -> Any:
        return b.select(b.fcmp_ordered(">=", value, threshold), b.fadd(tally, one), tally)

    return _elementwise(count, tally, tally, value, threshold)


@emitted
def within(_typing: Any, reading: Any, low: Any, width: Any) -> Any:
    """How far the reading lies above the low end, as a real number from 0 to the width."""
    above, least = f"llvm.usub.sat.v{WIDE}i16", f"llvm.umin.v{WIDE}i16"

    def cut(b: Any, reading: Any, low: Any, width: Any) -> Any:
        return b.uitofp(_call(b, least, _call(b, above, reading, low), width), _VECTORS["float64"])

    return _elementwise(cut, Lanes("float64", reading.vectors), reading, low, width)


def _inlined(function: Function) -> Function:
    """Compiled into whatever calls it: a call would send all registers through memory."""
    compiled: Function = numba.njit(forceinline=True, error_model="numpy")(function)
    return compiled


@_inlined
def _substep(m: Any, q: Any, fired: Any, w: Any, c: Any, old_v: Any, coupled: Any) -> Any:
    """One Euler step in the normal form."""
    keep, take, threshold, reset_to, jump = c
    after = fma(m, m, fma(take, q, w))
    seen = m if old_v else after
    q = fma(keep, q, seen) if coupled else mul(keep, q)
    fired = tallied(fired, after, threshold)
    q = reached(after, threshold, add(q, jump), q)
    return reached(after, threshold, reset_to, after), q, fired


@_inlined
def _sample(m: Any, q: Any, fired: Any, w: Any, c: Any, n: Any, old_v: Any, coupled: Any) -> Any:
    """A sample of ``n`` substeps; four of them in a row are laid out without a loop."""
    for _ in range(n // 4):
        m, q, fired = _substep(m, q, fired, w, c, old_v, coupled)
        m, q, fired = _substep(m, q, fired, w, c, old_v, coupled)
        m, q, fired = _substep(m, q, fired, w, c, old_v, coupled)
        m, q, fired = _substep(m, q, fired, w, c, old_v, coupled)
    for _ in range(n % 4):
        m, q, fired = _substep(m, q, fired, w, c, old_v, coupled)
    return m, q, fired


@_inlined
def _published_sample(v: Any, u: Any, fired: Any, w: Any, c: Any, p: Any, n: Any) -> Any:
    """A sample of a scheme that resets at the next one, in the order that was published."""
    _, _, threshold, reset_to, jump = c
    h, quadratic, linear, constant, a_u, b_u, u_step, ceiling = p
    u = reached(v, threshold, add(u, jump), u)
    v = reached(v, threshold, reset_to, v)
    for _ in range(n):
        rise = add(add(mul(quadratic, mul(v, v)), mul(linear, v)), constant)
        v = add(v, mul(h, add(sub(rise, u), w)))
    fired = tallied(fired, v, threshold)
    v = reached(v, ceiling, ceiling, v)
    return v, add(u, mul(u_step, mul(a_u, sub(mul(b_u, v), u)))), fired


@cache
def kernel(
    *,
    substeps: int,
    old_v: bool,
    coupled: bool,
    late: bool,
    signed: bool,
    sa_only: bool,
    traced: bool,
) -> Kernel:
    """Compile one scheme; :func:`rigctl.encoding.kernel.kernel_for` says how it is called.

    The arguments are constants of the compiled code, not tests at run time. numba keeps closures
    over plain numbers in its disk cache.
    """
    channels = 1 if sa_only else 2
    g = VECTORS_OF_SA if sa_only else VECTORS
    wide = WIDE * g

    # One long function on purpose: what its loop carries on is in registers.
    def advance(
        samples: Any,
        low: Any,
        width: Any,
        scale: Any,
        sa_drive: Any,
        ra_drive: Any,
        k: Any,
        state: Any,
        ends: Any,
        counts: Any,
        trace: Any,
    ) -> None:
        stride, lanes, rows = samples.shape[1], low.shape[0], ends.shape[0]
        w0, fall = full(k[W0], g), full(k[FALL], g)
        c = (
            full(k[KEEP], g),
            full(k[TAKE], g),
            full(k[THRESHOLD], g),
            full(k[RESET_TO], g),
            full(k[JUMP], g),
        )
        b0, b1, b2, a1, a2 = (
            full(k[B0], g),
            full(k[B1], g),
            full(k[B2], g),
            full(k[A1], g),
            full(k[A2], g),
        )
        p = (
            full(k[H], g), full(k[QUADRATIC], g), full(k[LINEAR], g), full(k[CONSTANT], g),
            full(k[A_U], g), full(k[B_U], g), full(k[U_STEP], g), full(k[CEILING], g),
        )  # fmt: skip
        for lane in range(0, lanes, wide):
            from_, range_, factor = load(low, lane, g), load(width, lane, g), load(scale, lane, g)
            per_sa, per_ra = load(sa_drive, lane, g), load(ra_drive, lane, g)
            m, m_ra = load(state, M * lanes + lane, g), load(state, M_RA * lanes + lane, g)
            q, q_ra = load(state, Q * lanes + lane, g), load(state, Q_RA * lanes + lane, g)
            z1, z2 = load(state, Z1 * lanes + lane, g), load(state, Z2 * lanes + lane, g)
            last = load(state, LAST * lanes + lane, g)
            t = 0
            for row in range(rows):
                fired, fired_ra = full(0.0, g), full(0.0, g)
                while t < ends[row]:
                    x = within(load(samples, t * stride + lane, g), from_, range_)
                    if late:
                        x = mul(x, factor)
                        w = mul(per_sa, x)
                        m, q, fired = _published_sample(m, q, fired, w, c, p, substeps)
                    else:
                        w = fma(per_sa, x, w0)
                        m, q, fired = _sample(m, q, fired, w, c, substeps, old_v, coupled)
                    if not sa_only:
                        if late:
                            y = add(mul(b0, x), z1)
                            z1 = sub(add(z2, mul(b1, x)), mul(a1, y))
                            z2 = sub(mul(b2, x), mul(a2, y))
                            slope, last = sub(y, last), y
                        else:
                            change, last = sub(x, last), x
                            slope = add(change, z1)
                            z1 = fma(a1, slope, add(add(change, change), z2))
                            z2 = fma(a2, slope, change)
                        if not signed:
                            slope = larger(slope, mul(fall, slope))
                        if late:
                            w = mul(per_ra, slope)
                            m_ra, q_ra, fired_ra = _published_sample(
                                m_ra, q_ra, fired_ra, w, c, p, substeps
                            )
                        else:
                            w = fma(per_ra, slope, w0)
                            m_ra, q_ra, fired_ra = _sample(
                                m_ra, q_ra, fired_ra, w, c, substeps, old_v, coupled
                            )
                    t += 1
                place = (lane * rows + row * wide) * channels
                store(counts, place, as_bytes(fired))
                if traced:
                    store(trace, place, m)
                if not sa_only:
                    store(counts, place + wide, as_bytes(fired_ra))
                    if traced:
                        store(trace, place + wide, m_ra)
            store(state, M * lanes + lane, m)
            store(state, Q * lanes + lane, q)
            if not sa_only:
                store(state, M_RA * lanes + lane, m_ra)
                store(state, Q_RA * lanes + lane, q_ra)
                store(state, Z1 * lanes + lane, z1)
                store(state, Z2 * lanes + lane, z2)
                store(state, LAST * lanes + lane, last)

    compile_advance = numba.njit(
        cache=True, nogil=True, fastmath=False, error_model="numpy", boundscheck=False
    )
    compiled: Kernel = compile_advance(advance)
    return compiled
