"""The kernel in machine code: 64 neurons side by side, whose states stay in the nearest cache.

A neuron's substeps wait for each other, each of them for some fifteen cycles, so many neurons take
turns. First the currents of a stretch are made, a few lanes at a time; then all 64 neurons of a
block go through it substep by substep (where a scheme resets at the next sample, 32 of them sample
by sample). Spikes are counted in bytes, 32 lanes at a time.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba.core import types

from rigctl.encoding.lanes import (
    FMA,
    IN_UNIT,
    MASKED,
    UNIT,
    VECTORS,
    WIDE,
    Lanes,
    add,
    call,
    emitted_for,
    fma,
    full,
    inlined,
    larger,
    load,
    mul,
    own,
    parts,
    places_of,
    reached,
    store,
    sub,
    whole,
    within,
)
from rigctl.encoding.tally import collected, counted, in_order, no_spikes, spiking

Kernel = Callable[..., None]

# A block is two units of lanes: SA and RA, or both SA.
BLOCK = 2 * UNIT
LANES, LANES_OF_SA = UNIT, 2 * UNIT

# Rows of the state: membrane and recovery of SA and RA, and the RA channel's filter.
M, Q, M_RA, Q_RA, Z1, Z2, LAST = range(7)
STATE_ROWS = 7

# Positions in the vector of folded constants.
W0, KEEP, TAKE, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING, FALL = range(11, 20)

# Samples whose currents are made at a time, for two vectors of lanes at once.
AT_A_TIME, PAIR = 16, 2

# Where a block's numbers lie in memory of its own: membranes, recoveries, currents.
OWN_Q, OWN_W, OWN_SIZE = BLOCK, 2 * BLOCK, (2 + AT_A_TIME) * BLOCK

# numba's disk cache knows the text of this file only, and what a closure holds: so a kernel holds
# what stands for the other files that it is made of.
_FILES = (Path(__file__).with_name(name) for name in ("lanes.py", "tally.py"))
_SOURCES = zlib.crc32(b"".join(file.read_bytes() for file in _FILES))


def _fenced(b: Any, memory: Any) -> None:
    """Have what is stored stay stored, and the vectors keep their order."""
    kind = ir.FunctionType(ir.VoidType(), [memory.type])
    b.call(ir.InlineAsm(kind, "", "r,~{memory}", side_effect=True), [memory])


@emitted_for
def substep(
    _typing: Any, block: Any, unit: Any, w_at: Any, c: Any, old_v: Any, coupled: Any
) -> Any:
    """One Euler step in the normal form of a unit of a block, in its memory: the spikes."""
    ways = (old_v.literal_value, coupled.literal_value)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        memory, of_m, of_w, constants, *_ = arguments
        told = [parts(builder, each)[0] for each in parts(builder, constants)]
        starts, lanes = (of_m, builder.add(of_m, of_m.type(OWN_Q)), of_w), Lanes("float64", IN_UNIT)
        rows = [places_of(context, builder, block, memory, at, lanes)[0] for at in starts]

        def step_one(i: int) -> Any:
            m, q, w = (builder.load(row[i], align=8 * WIDE) for row in rows)
            *both, spike = _stepped(builder, m, q, w, *told, *ways)
            for value, row in zip(both, rows, strict=False):
                builder.store(value, row[i], align=8 * WIDE)
            if not MASKED:  # in half as many registers of half the size there is no room for more
                _fenced(builder, memory)
            return spike

        return whole(builder, [builder.bitcast(collected(builder, step_one), VECTORS["uint8"])])

    return Lanes("uint8", 1)(block, types.intp, types.intp, c, old_v, coupled), generate


def _stepped(b: Any, m: Any, q: Any, w: Any, *told: Any) -> tuple[Any, Any, Any]:
    """Membrane and recovery of one vector, and in which of its lanes there is a spike."""
    keep, take, threshold, reset_to, jump, old_v, coupled = told
    after = call(b, FMA, m, m, call(b, FMA, take, q, w))
    q = call(b, FMA, keep, q, m if old_v else after) if coupled else b.fmul(keep, q)
    spike = b.fcmp_ordered(">=", after, threshold)
    if MASKED:
        q = b.select(spike, b.fadd(q, jump), q)
    else:  # the jump or 0 is chosen while q is still computed
        q = b.fadd(q, b.select(spike, jump, ir.Constant(jump.type, [0.0] * WIDE)))
    return b.select(spike, reset_to, after), q, spike


@inlined
def _slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """The filtered reading's change, without b0, and the filter and the reading behind it."""
    change = sub(x, last)
    slope = add(change, z1)
    z1 = fma(full(k[A1], PAIR), slope, fma(full(2.0, PAIR), change, z2))  # 2 · change is exact
    return slope, z1, fma(full(k[A2], PAIR), slope, change), x


@inlined
def _published_slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """The same, with b0, in the order that was published; behind it the filtered reading."""
    y = add(mul(full(k[B0], PAIR), x), z1)
    z1 = sub(add(z2, mul(full(k[B1], PAIR), x)), mul(full(k[A1], PAIR), y))
    z2 = sub(mul(full(k[B2], PAIR), x), mul(full(k[A2], PAIR), y))
    return sub(y, last), z1, z2, y


@inlined
def _currents(
    samples: Any, first: Any, stop: Any, of_lanes: Any, lane: Any, k: Any, state: Any,
    block: Any, at: Any, ways: Any,
) -> None:  # fmt: skip
    """What goes into the neurons of some lanes in some samples, from the readings on."""
    low, width, scale, sa_drive, ra_drive = of_lanes
    late, signed, sa_only = ways
    lane += at
    from_, range_ = load(low, lane, PAIR), load(width, lane, PAIR)
    factor, per_sa = load(scale, lane, PAIR), load(sa_drive, lane, PAIR)
    per_ra, w0, fall = load(ra_drive, lane, PAIR), full(k[W0], PAIR), full(k[FALL], PAIR)
    z1_at, z2_at, last_at = Z1 * len(low) + lane, Z2 * len(low) + lane, LAST * len(low) + lane
    z1, z2, last = load(state, z1_at, PAIR), load(state, z2_at, PAIR), load(state, last_at, PAIR)
    to = OWN_W + at
    for t in range(first, stop):
        x = within(load(samples, t * samples.shape[1] + lane, PAIR), from_, range_)
        x = mul(x, factor) if late else x
        store(block, to, mul(per_sa, x) if late else fma(per_sa, x, w0))
        if not sa_only:
            if late:
                slope, z1, z2, last = _published_slope(x, z1, z2, last, k)
            else:
                slope, z1, z2, last = _slope(x, z1, z2, last, k)
            slope = slope if signed else larger(slope, mul(fall, slope))
            store(block, to + UNIT, mul(per_ra, slope) if late else fma(per_ra, slope, w0))
        to += BLOCK
    store(state, z1_at, z1)
    store(state, z2_at, z2)
    store(state, last_at, last)


@inlined
def _published_sample(block: Any, unit: Any, w_at: Any, k: Any, n: Any) -> Any:
    """A unit's sample in a scheme that resets at the next, in the order that was published."""
    h, quadratic = full(k[H], IN_UNIT), full(k[QUADRATIC], IN_UNIT)
    linear, constant = full(k[LINEAR], IN_UNIT), full(k[CONSTANT], IN_UNIT)
    a_u, b_u, u_step = full(k[A_U], IN_UNIT), full(k[B_U], IN_UNIT), full(k[U_STEP], IN_UNIT)
    threshold, ceiling = full(k[THRESHOLD], IN_UNIT), full(k[CEILING], IN_UNIT)
    v, u = load(block, unit, IN_UNIT), load(block, OWN_Q + unit, IN_UNIT)
    w = load(block, w_at, IN_UNIT)
    u = reached(v, threshold, add(u, full(k[JUMP], IN_UNIT)), u)
    v = reached(v, threshold, full(k[RESET_TO], IN_UNIT), v)
    for _ in range(n):
        rise = add(add(mul(quadratic, mul(v, v)), mul(linear, v)), constant)
        v = add(v, mul(h, add(sub(rise, u), w)))
    spikes = spiking(v, threshold)
    v = reached(v, ceiling, ceiling, v)
    store(block, unit, v)
    store(block, OWN_Q + unit, add(u, mul(u_step, mul(a_u, sub(mul(b_u, v), u)))))
    return spikes


@inlined
def _copied(array: Any, at: Any, block: Any, own_at: Any, back: Any) -> None:
    """Copy a unit's numbers from an array into a block's memory, or back."""
    for i in range(0, UNIT, WIDE):
        if back:
            store(array, at + i, load(block, own_at + i, 1))
        else:
            store(block, own_at + i, load(array, at + i, 1))


@inlined
def _carried(state: Any, lanes: Any, lane: Any, sa_only: Any, block: Any, back: Any) -> None:
    """Copy a block's membranes and recoveries from the state of all lanes, or back."""
    m, q = M * lanes + lane, Q * lanes + lane
    other_m, other_q = M_RA * lanes + lane, Q_RA * lanes + lane
    if sa_only:
        other_m, other_q = m + UNIT, q + UNIT
    _copied(state, m, block, 0, back)
    _copied(state, other_m, block, UNIT, back)
    _copied(state, q, block, OWN_Q, back)
    _copied(state, other_q, block, OWN_Q + UNIT, back)


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
    wide, made_of = LANES_OF_SA if sa_only else LANES, _SOURCES

    def advance(
        samples: Any, low: Any, width: Any, scale: Any, sa_drive: Any, ra_drive: Any,
        k: Any, state: Any, ends: Any, counts: Any, trace: Any,
    ) -> None:  # fmt: skip
        _ = made_of
        lanes, rows, n = low.shape[0], ends.shape[0], ends[-1]
        of_lanes, ways = (low, width, scale, sa_drive, ra_drive), (late, signed, sa_only)
        reset = (full(k[THRESHOLD], 1), full(k[RESET_TO], 1), full(k[JUMP], 1))
        c = (full(k[KEEP], 1), full(k[TAKE], 1), *reset)
        block = own("float64", OWN_SIZE)
        for lane in range(0, lanes, wide):
            _carried(state, lanes, lane, sa_only, block, False)
            one, two, row = no_spikes(), no_spikes(), 0
            for first in range(0, n, AT_A_TIME):
                stop = min(first + AT_A_TIME, n)
                for at in range(0, wide, PAIR * WIDE):
                    _currents(samples, first, stop, of_lanes, lane, k, state, block, at, ways)
                for t in range(first, stop):
                    w1 = OWN_W + (t - first) * BLOCK
                    w2 = w1 + UNIT
                    if late:
                        one = counted(one, _published_sample(block, 0, w1, k, substeps))
                        two = counted(two, _published_sample(block, UNIT, w2, k, substeps))
                    for _ in range(0 if late else substeps):
                        one = counted(one, substep(block, 0, w1, c, old_v, coupled))
                        two = counted(two, substep(block, UNIT, w2, c, old_v, coupled))
                    if t + 1 == ends[row]:
                        place = (lane // wide * rows + row) * BLOCK
                        store(counts, place, in_order(one))
                        store(counts, place + UNIT, in_order(two))
                        if traced:
                            _copied(trace, place, block, 0, True)
                            _copied(trace, place + UNIT, block, UNIT, True)
                        one, two, row = no_spikes(), no_spikes(), row + 1
            _carried(state, lanes, lane, sa_only, block, True)

    compile_advance = numba.njit(
        cache=True, nogil=True, fastmath=False, error_model="numpy", boundscheck=False
    )
    compiled: Kernel = compile_advance(advance)
    return compiled
