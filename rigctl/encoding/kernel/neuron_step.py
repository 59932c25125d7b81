"""What the 64 neurons of a block do in a substep or a sample, in memory of the block's own.

A neuron's substeps wait for each other, each of them for some fifteen cycles, so many neurons take
turns. Vectors of neurons are loaded, stepped and stored one by one; the next is begun before one is
finished.
"""

from __future__ import annotations

from collections import deque
from functools import partial
from typing import Any

from llvmlite import ir
from numba.core import types

from rigctl.encoding.kernel.prefetch import RUN, read_run
from rigctl.encoding.kernel.simd import (
    FMA,
    IN_UNIT,
    MASKED,
    UNIT,
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
    parts,
    places_of,
    reached,
    store,
    sub,
    whole,
    within,
)
from rigctl.encoding.kernel.spike_counters import collected, in_turn, of_block, spiking

# A block is two units of lanes: SA and RA, or both SA.
BLOCK = 2 * UNIT

# Rows of the state: membrane and recovery of SA and RA, and the RA channel's filter.
M, Q, M_RA, Q_RA, Z1, Z2, LAST = range(7)
STATE_ROWS = 7

# Positions in the vector of folded constants.
W0, KEEP, TAKE, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING, FALL = range(11, 20)

# Samples whose currents are made at a time, and vectors of the lanes that are made at once.
AT_A_TIME, OF_RUN = 32, RUN // WIDE

# Where a block's numbers lie in memory of its own: membranes, recoveries, currents.
OWN_Q, OWN_W, OWN_SIZE = BLOCK, 2 * BLOCK, (2 + AT_A_TIME) * BLOCK


def _put(b: Any, memory: Any, value: Any, place: Any) -> None:
    """Store a vector; what is stored stays stored, and the vectors keep their order."""
    b.store(value, place, align=8 * WIDE)
    if not MASKED:  # in half as many registers of half the size there is no room for more
        kind = ir.FunctionType(ir.VoidType(), [memory.type])
        b.call(ir.InlineAsm(kind, "", "r,~{memory}", side_effect=True), [memory])


@emitted_for
def substep(_typing: Any, block: Any, w_at: Any, c: Any, old_v: Any, coupled: Any) -> Any:
    """One Euler step in the normal form of a whole block: the spikes."""
    is_old, is_coupled = old_v.literal_value, coupled.literal_value

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        memory, of_w, constants, *_ = arguments
        take, *told = (parts(builder, each)[0] for each in parts(builder, constants))
        starts, lanes = (of_w.type(0), of_w.type(OWN_Q), of_w), Lanes("float64", 2 * IN_UNIT)
        rows = [places_of(context, builder, block, memory, at, lanes)[0] for at in starts]
        to_come = deque(unit + i for unit in (0, IN_UNIT) for i in in_turn())
        begun: deque[tuple[Any, ...]] = deque()
        put = partial(_put, builder, memory)

        def begin() -> None:
            i = to_come.popleft()
            places = [row[i] for row in rows]
            begun.append((*places[:2], *_begun(builder, places, take)))

        def step_next(_: int) -> Any:
            if to_come:
                begin()
            of_m, of_q, m, after = begun.popleft()
            follows = (m if is_old else after) if is_coupled else None
            return _finished(builder, put, of_m, of_q, after, follows, *told)

        begin()
        return whole(builder, [collected(builder, step_next) for _ in range(2)])

    return Lanes("uint8", 2)(block, types.intp, c, old_v, coupled), generate


def _begun(b: Any, places: list[Any], take: Any) -> tuple[Any, Any]:
    """A vector's membrane before the step and behind it."""
    m, q, w = (b.load(place, align=8 * WIDE) for place in places)
    return m, call(b, FMA, m, m, call(b, FMA, take, q, w))


def _finished(
    b: Any, put: Any, of_m: Any, of_q: Any, after: Any, follows: Any,
    keep: Any, threshold: Any, reset_to: Any, jump: Any,
) -> Any:  # fmt: skip
    """Store a vector's membrane and recovery: in which of its lanes there is a spike.

    ``follows``: the membrane that recovery follows, if any.
    """
    spike = b.fcmp_ordered(">=", after, threshold)
    put(b.select(spike, reset_to, after), of_m)
    # Loaded only now, or once more, it is multiplied from memory and has taken no register.
    q = b.load(of_q, align=8 * WIDE)
    q = b.fmul(keep, q) if follows is None else call(b, FMA, keep, q, follows)
    if MASKED:
        put(b.select(spike, b.fadd(q, jump), q), of_q)
    else:  # the jump or 0 is chosen while q is still computed
        put(b.fadd(q, b.select(spike, jump, ir.Constant(jump.type, [0.0] * WIDE))), of_q)
    return spike


@inlined
def _slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """The filtered reading's change, without b0, and the filter and the reading behind it."""
    change = sub(x, last)
    slope = add(change, z1)
    z1 = fma(full(k[A1], OF_RUN), slope, fma(full(2.0, OF_RUN), change, z2))  # 2 · change is exact
    return slope, z1, fma(full(k[A2], OF_RUN), slope, change), x


@inlined
def _published_slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """The same, with b0, in the order that was published; behind it the filtered reading."""
    y = add(mul(full(k[B0], OF_RUN), x), z1)
    z1 = sub(add(z2, mul(full(k[B1], OF_RUN), x)), mul(full(k[A1], OF_RUN), y))
    z2 = sub(mul(full(k[B2], OF_RUN), x), mul(full(k[A2], OF_RUN), y))
    return sub(y, last), z1, z2, y


@inlined
def currents(
    source: Any, row_bytes: Any, n: Any, of_lanes: Any, lane: Any, k: Any, state: Any,
    block: Any, at: Any, ways: Any,
) -> None:  # fmt: skip
    """What goes into the neurons of eight lanes in some samples, from the readings on.

    ``source``: where in memory the first sample's readings lie, the next ``row_bytes`` further.
    """
    low, width, scale, sa_drive, ra_drive = of_lanes
    late, signed, sa_only = ways
    from_, range_ = load(low, lane, OF_RUN), load(width, lane, OF_RUN)
    factor, per_sa = load(scale, lane, OF_RUN), load(sa_drive, lane, OF_RUN)
    per_ra, w0, fall = load(ra_drive, lane, OF_RUN), full(k[W0], OF_RUN), full(k[FALL], OF_RUN)
    z1_at, z2_at, last_at = Z1 * len(low) + lane, Z2 * len(low) + lane, LAST * len(low) + lane
    z1, z2, last = (
        load(state, z1_at, OF_RUN),
        load(state, z2_at, OF_RUN),
        load(state, last_at, OF_RUN),
    )
    to = OWN_W + at
    for _ in range(n):
        x = within(read_run(source), from_, range_)
        x = mul(x, factor) if late else x
        store(block, to, mul(per_sa, x) if late else fma(per_sa, x, w0))
        if not sa_only:
            if late:
                slope, z1, z2, last = _published_slope(x, z1, z2, last, k)
            else:
                slope, z1, z2, last = _slope(x, z1, z2, last, k)
            slope = slope if signed else larger(slope, mul(fall, slope))
            store(block, to + UNIT, mul(per_ra, slope) if late else fma(per_ra, slope, w0))
        to, source = to + BLOCK, source + row_bytes
    store(state, z1_at, z1)
    store(state, z2_at, z2)
    store(state, last_at, last)


@inlined
def _published_unit(block: Any, unit: Any, w_at: Any, k: Any, n: Any) -> Any:
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
def published_sample(block: Any, w_at: Any, k: Any, n: Any) -> Any:
    """A block's sample in such a scheme, unit by unit."""
    one = _published_unit(block, 0, w_at, k, n)
    return of_block(one, _published_unit(block, UNIT, w_at + UNIT, k, n))


@inlined
def copied(array: Any, at: Any, block: Any, own_at: Any, back: Any) -> None:
    """Copy a unit's numbers from an array into a block's memory, or back."""
    for i in range(0, UNIT, WIDE):
        if back:
            store(array, at + i, load(block, own_at + i, 1))
        else:
            store(block, own_at + i, load(array, at + i, 1))


@inlined
def carried(state: Any, lanes: Any, lane: Any, sa_only: Any, block: Any, back: Any) -> None:
    """Copy a block's membranes and recoveries from the state of all lanes, or back."""
    m, q = M * lanes + lane, Q * lanes + lane
    other_m, other_q = M_RA * lanes + lane, Q_RA * lanes + lane
    if sa_only:
        other_m, other_q = m + UNIT, q + UNIT
    copied(state, m, block, 0, back)
    copied(state, other_m, block, UNIT, back)
    copied(state, q, block, OWN_Q, back)
    copied(state, other_q, block, OWN_Q + UNIT, back)
