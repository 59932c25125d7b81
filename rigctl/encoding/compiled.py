"""The kernel in machine code: dozens of neurons at a time, in registers where there are enough.

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
import numpy as np
from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

Kernel = Callable[..., None]
Function = Callable[..., Any]

# Several vectors hide each other's latency: four of SA and four of RA, or six of SA alone.
WIDE = 8
VECTORS, VECTORS_OF_SA = 4, 6
LANES, LANES_OF_SA = WIDE * VECTORS, WIDE * VECTORS_OF_SA

# So many states have room in 32 registers of a whole vector, which come with masks for choices.
MASKED = bool(binding.get_host_cpu_features().get("avx512f"))

# Rows of the state: membrane and recovery of SA and RA, and the RA channel's filter.
M, Q, M_RA, Q_RA, Z1, Z2, LAST = range(7)
STATE_ROWS = 7

# Positions in the vector of folded constants.
W0, KEEP, TAKE, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING, FALL, SUBSTEPS = range(11, 21)

FMA = f"llvm.fma.v{WIDE}f64"
_VECTORS = {
    "float64": ir.VectorType(ir.DoubleType(), WIDE),
    "int64": ir.VectorType(ir.IntType(64), WIDE),
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


def _places(context: Any, builder: Any, kind: Any, array: Any, index: Any, lanes: Lanes) -> Any:
    """Pointers to a block's vectors in an array, from a flat index on."""
    vector = _VECTORS[lanes.element]
    steps = [ir.Constant(index.type, WIDE * i) for i in range(lanes.vectors)]
    indices = [builder.add(index, step) for step in steps]
    return [pointer(context, builder, kind, array, i, vector) for i in indices]


@_emitted_for
def load(_typing: Any, array: Any, index: Any, vectors: Any) -> Any:
    """A block's numbers from a contiguous array, from a flat index on."""
    kind = Lanes(str(array.dtype), vectors.literal_value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(context, builder, array, arguments[0], arguments[1], kind)
        size = array.dtype.bitwidth // 8
        return _whole(builder, [builder.load(place, align=size) for place in places])

    return kind(array, types.intp, vectors), generate


@emitted
def store(_typing: Any, array: Any, index: Any, value: Any) -> Any:
    """Write a block's numbers into a contiguous array, from a flat index on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        places = _places(context, builder, array, arguments[0], arguments[1], value)
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
    narrow = Lanes("uint8", tally.vectors)
    return _elementwise(lambda b, tally: b.trunc(tally, _VECTORS["uint8"]), narrow, tally)


@emitted
def fma(_typing: Any, x: Any, y: Any, z: Any) -> Any:
    """x · y + z, rounded once."""
    return _elementwise(lambda b, *xyz: _call(b, FMA, *xyz), x, x, y, z)


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


def _count(builder: Any, place: Any, spike: Any) -> None:
    """Make the tally at a place in memory one higher in the lanes that have a spike."""
    ones = builder.sext(spike, _VECTORS["int64"])
    builder.store(builder.sub(builder.load(place, align=8), ones), place, align=8)


@emitted
def tallied(_typing: Any, tally: Any, at: Any, value: Any, threshold: Any) -> Any:
    """Count in an array, from a flat index on, the lanes in which the threshold is reached."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        array, index, *both = arguments
        places = _places(context, builder, tally, array, index, Lanes("int64", value.vectors))
        for place, *pair in zip(places, *(_parts(builder, each) for each in both), strict=True):
            _count(builder, place, builder.fcmp_ordered(">=", *pair))
        return context.get_dummy_value()

    return types.void(tally, types.intp, value, threshold), generate


@emitted
def within(_typing: Any, reading: Any, low: Any, width: Any) -> Any:
    """How far the reading lies above the low end, as a real number from 0 to the width."""
    above, least = f"llvm.usub.sat.v{WIDE}i16", f"llvm.umin.v{WIDE}i16"

    def cut(b: Any, reading: Any, low: Any, width: Any) -> Any:
        return b.uitofp(_call(b, least, _call(b, above, reading, low), width), _VECTORS["float64"])

    return _elementwise(cut, Lanes("float64", reading.vectors), reading, low, width)


@_emitted_for
def substep(
    _typing: Any, m: Any, q: Any, w: Any, c: Any, old_v: Any, coupled: Any, tally: Any, at: Any
) -> Any:
    """One Euler step in the normal form: (membrane, recovery) after it.

    Spikes are added to those in the array ``tally``, from a flat index on.
    """
    ways = (old_v.literal_value, coupled.literal_value)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        *state, constants, _, _, array, index = arguments
        places = _places(context, builder, tally, array, index, Lanes("int64", m.vectors))
        told, done = (*state, *_parts(builder, constants)), []
        # Vector after vector: of so many at once too few registers would be left.
        for place, *vectors in zip(places, *(_parts(builder, v) for v in told), strict=True):
            *both, spike = _stepped(builder, *vectors, *ways)
            done.append(both)
            _count(builder, place, spike)
        # Tallies in registers would drive the state out of them: what is stored stays stored.
        stored = ir.InlineAsm(ir.FunctionType(ir.VoidType(), []), "", "~{memory}", side_effect=True)
        builder.call(stored, [])
        wholes = [_whole(builder, list(parts)) for parts in zip(*done, strict=True)]
        return context.make_tuple(builder, signature.return_type, wholes)

    pair: Any = types.UniTuple
    return pair(m, 2)(m, q, w, c, old_v, coupled, tally, at), generate


def _stepped(b: Any, m: Any, q: Any, w: Any, *told: Any) -> tuple[Any, Any, Any]:
    """Membrane and recovery of one vector, and in which of its lanes there is a spike."""
    keep, take, threshold, reset_to, jump, old_v, coupled = told
    after = _call(b, FMA, m, m, _call(b, FMA, take, q, w))
    q = _call(b, FMA, keep, q, m if old_v else after) if coupled else b.fmul(keep, q)
    spike = b.fcmp_ordered(">=", after, threshold)
    if MASKED:
        q = b.select(spike, b.fadd(q, jump), q)
    else:  # the jump or 0 is chosen while q is still computed
        q = b.fadd(q, b.select(spike, jump, ir.Constant(jump.type, [0.0] * WIDE)))
    return b.select(spike, reset_to, after), q, spike


def _inlined(function: Function) -> Function:
    """Compiled into whatever calls it: a call would send all registers through memory."""
    compiled: Function = numba.njit(forceinline=True, error_model="numpy")(function)
    return compiled


@_inlined
def _published_sample(v: Any, u: Any, w: Any, c: Any, p: Any, n: Any, tally: Any, at: Any) -> Any:
    """A sample of a scheme that resets at the next one, in the order that was published."""
    _, _, threshold, reset_to, jump = c
    h, quadratic, linear, constant, a_u, b_u, u_step, ceiling = p
    u = reached(v, threshold, add(u, jump), u)
    v = reached(v, threshold, reset_to, v)
    for _ in range(n):
        rise = add(add(mul(quadratic, mul(v, v)), mul(linear, v)), constant)
        v = add(v, mul(h, add(sub(rise, u), w)))
    tallied(tally, at, v, threshold)
    v = reached(v, ceiling, ceiling, v)
    return v, add(u, mul(u_step, mul(a_u, sub(mul(b_u, v), u))))


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
        samples: Any, low: Any, width: Any, scale: Any, sa_drive: Any, ra_drive: Any,
        k: Any, state: Any, ends: Any, counts: Any, trace: Any,
    ) -> None:  # fmt: skip
        stride, lanes, rows = samples.shape[1], low.shape[0], ends.shape[0]
        w0, fall = full(k[W0], g), full(k[FALL], g)
        c = (
            full(k[KEEP], g), full(k[TAKE], g),
            full(k[THRESHOLD], g), full(k[RESET_TO], g), full(k[JUMP], g),
        )  # fmt: skip
        b0, b1, b2 = full(k[B0], g), full(k[B1], g), full(k[B2], g)
        a1, a2 = full(k[A1], g), full(k[A2], g)
        p = (
            full(k[H], g), full(k[QUADRATIC], g), full(k[LINEAR], g), full(k[CONSTANT], g),
            full(k[A_U], g), full(k[B_U], g), full(k[U_STEP], g), full(k[CEILING], g),
        )  # fmt: skip
        # Laid out in a row, substeps would be mingled until registers run out.
        n = substeps if MASKED else int(k[SUBSTEPS])
        tally = np.empty(channels * wide, np.int64)
        for lane in range(0, lanes, wide):
            from_, range_, factor = load(low, lane, g), load(width, lane, g), load(scale, lane, g)
            per_sa, per_ra = load(sa_drive, lane, g), load(ra_drive, lane, g)
            m, m_ra = load(state, M * lanes + lane, g), load(state, M_RA * lanes + lane, g)
            q, q_ra = load(state, Q * lanes + lane, g), load(state, Q_RA * lanes + lane, g)
            z1, z2 = load(state, Z1 * lanes + lane, g), load(state, Z2 * lanes + lane, g)
            last = load(state, LAST * lanes + lane, g)
            t = 0
            for row in range(rows):
                tally[:] = 0
                while t < ends[row]:
                    x = within(load(samples, t * stride + lane, g), from_, range_)
                    x = mul(x, factor) if late else x
                    w = mul(per_sa, x) if late else fma(per_sa, x, w0)
                    if late:
                        m, q = _published_sample(m, q, w, c, p, n, tally, 0)
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
                        w_ra = mul(per_ra, slope) if late else fma(per_ra, slope, w0)
                        if late:
                            of_ra = (m_ra, q_ra, w_ra)
                            m_ra, q_ra = _published_sample(*of_ra, c, p, n, tally, wide)
                    for _ in range(0 if late else n):
                        m, q = substep(m, q, w, c, old_v, coupled, tally, 0)
                        if not sa_only:
                            m_ra, q_ra = substep(m_ra, q_ra, w_ra, c, old_v, coupled, tally, wide)
                    t += 1
                place = (lane * rows + row * wide) * channels
                store(counts, place, as_bytes(load(tally, 0, g)))
                if traced:
                    store(trace, place, m)
                if not sa_only:
                    store(counts, place + wide, as_bytes(load(tally, wide, g)))
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
