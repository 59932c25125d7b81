"""Advance the 64 neurons of a block by a substep or a sample, in memory of the block's own.

The substeps of a neuron depend on each other, about fifteen cycles each, so many neurons alternate.
Vectors of neurons are loaded, stepped and stored one by one; the next starts before the last ends.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from llvmlite import ir
from numba.core import types

from rigctl.encoder.kernel.prefetch import RUN, read_run
from rigctl.encoder.kernel.simd import (
    FMA,
    HALF_LANES,
    HALF_VECTORS,
    HAS_AVX512,
    VECTOR_WIDTH,
    Lanes,
    add,
    broadcast,
    call_llvm,
    clip_to_range,
    fma,
    inline,
    literal_intrinsic,
    load,
    maximum,
    mul,
    pack,
    select_reached,
    store,
    sub,
    unpack,
    vector_pointers,
)
from rigctl.encoder.kernel.spike_counters import half_spikes, join_halves, pack_masks

# A block is two halves: SA and RA of the same lanes, or SA of twice as many.
BLOCK = 2 * HALF_LANES

# Rows of the state: membrane and recovery of SA and RA, and the RA channel's filter.
M, Q, M_RA, Q_RA, Z1, Z2, LAST = range(7)
STATE_ROWS = 7

# Indices of the kernel's constants.
W0, DECAY, COUPLING, THRESHOLD, RESET_TO, JUMP = range(6)
B0, B1, B2, A1, A2 = range(6, 11)
H, QUADRATIC, LINEAR, CONSTANT, A_U, B_U, U_STEP, CEILING, FALL = range(11, 20)

# Samples whose currents are computed at a time, and vectors of a run.
CHUNK_SAMPLES, RUN_VECTORS = 32, RUN // VECTOR_WIDTH

# Layout of a block's own memory: membranes, recoveries, currents.
BLOCK_Q, BLOCK_W, BLOCK_SIZE = BLOCK, 2 * BLOCK, (2 + CHUNK_SAMPLES) * BLOCK


def _store_in_order(b: Any, memory: Any, value: Any, place: Any) -> None:
    """Store a vector; the compiler must not hold it in a register or reorder the stores."""
    b.store(value, place, align=8 * VECTOR_WIDTH)
    if not HAS_AVX512:  # with half as many registers of half the size there is no room for more
        kind = ir.FunctionType(ir.VoidType(), [memory.type])
        b.call(ir.InlineAsm(kind, "", "r,~{memory}", side_effect=True), [memory])


@literal_intrinsic
def substep(_typing: Any, block: Any, w_at: Any, c: Any, old_v: Any, coupled: Any) -> Any:
    """Advance a whole block by one Euler step in the normal form; return the spikes."""
    is_old, is_coupled = old_v.literal_value, coupled.literal_value

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        memory, w_at, constants, *_ = arguments
        coupling, *others = (unpack(builder, each)[0] for each in unpack(builder, constants))
        starts, lanes = (w_at.type(0), w_at.type(BLOCK_Q), w_at), Lanes("float64", 2 * HALF_VECTORS)
        rows = [vector_pointers(context, builder, block, memory, at, lanes)[0] for at in starts]
        put = partial(_store_in_order, builder, memory)

        def step(i: int) -> Any:
            pointers = [row[i] for row in rows]
            return _step_vector(builder, put, pointers, is_old, is_coupled, coupling, *others)

        halves = (0, HALF_VECTORS)
        return pack(builder, [pack_masks(builder, lambda i, h=h: step(h + i)) for h in halves])

    return Lanes("uint8", 2)(block, types.intp, c, old_v, coupled), generate


def _step_vector(
    b: Any, put: Any, pointers: list[Any], is_old: bool, is_coupled: bool,
    coupling: Any, decay: Any, threshold: Any, reset_to: Any, jump: Any,
) -> Any:  # fmt: skip
    """Advance a vector, given by pointers to m, q and w; return the mask of its spikes."""
    m_at, q_at, _ = pointers
    m, q, w = (b.load(each, align=8 * VECTOR_WIDTH) for each in pointers)
    after = call_llvm(b, FMA, m, m, call_llvm(b, FMA, coupling, q, w))
    spike = b.fcmp_ordered(">=", after, threshold)
    put(b.select(spike, reset_to, after), m_at)
    drive = m if is_old else after
    q = call_llvm(b, FMA, decay, q, drive) if is_coupled else b.fmul(decay, q)
    put(b.select(spike, b.fadd(q, jump), q), q_at)
    return spike


@inline
def _slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """Return the change of the filtered reading, without b0, the filter's state and the reading."""
    change = sub(x, last)
    slope = add(change, z1)
    twice = fma(broadcast(2.0, RUN_VECTORS), change, z2)  # 2 · change is exact
    z1 = fma(broadcast(k[A1], RUN_VECTORS), slope, twice)
    return slope, z1, fma(broadcast(k[A2], RUN_VECTORS), slope, change), x


@inline
def _published_slope(x: Any, z1: Any, z2: Any, last: Any, k: Any) -> Any:
    """Return the same with b0 in the published order, and the filtered reading."""
    y = add(mul(broadcast(k[B0], RUN_VECTORS), x), z1)
    feedback = mul(broadcast(k[A1], RUN_VECTORS), y)
    z1 = sub(add(z2, mul(broadcast(k[B1], RUN_VECTORS), x)), feedback)
    z2 = sub(mul(broadcast(k[B2], RUN_VECTORS), x), mul(broadcast(k[A2], RUN_VECTORS), y))
    return sub(y, last), z1, z2, y


@inline
def compute_currents(
    source: Any, row_bytes: Any, n: Any, ranges: Any, lane: Any, k: Any, state: Any,
    block: Any, at: Any, options: Any,
) -> None:  # fmt: skip
    """Compute the input currents of a run's neurons in ``n`` samples from its readings.

    ``source``: address of the first sample's readings, the next ``row_bytes`` further.
    """
    low, width, scale, sa_drive, ra_drive = ranges
    late_reset, signed, sa_only = options
    lows, widths = load(low, lane, RUN_VECTORS), load(width, lane, RUN_VECTORS)
    factor, sa_gain = load(scale, lane, RUN_VECTORS), load(sa_drive, lane, RUN_VECTORS)
    ra_gain, w0 = load(ra_drive, lane, RUN_VECTORS), broadcast(k[W0], RUN_VECTORS)
    fall = broadcast(k[FALL], RUN_VECTORS)
    z1_at, z2_at, last_at = Z1 * len(low) + lane, Z2 * len(low) + lane, LAST * len(low) + lane
    z1, z2 = load(state, z1_at, RUN_VECTORS), load(state, z2_at, RUN_VECTORS)
    last, to = load(state, last_at, RUN_VECTORS), BLOCK_W + at
    for _ in range(n):
        x = clip_to_range(read_run(source), lows, widths)
        x = mul(x, factor) if late_reset else x
        store(block, to, mul(sa_gain, x) if late_reset else fma(sa_gain, x, w0))
        if not sa_only:
            if late_reset:
                slope, z1, z2, last = _published_slope(x, z1, z2, last, k)
            else:
                slope, z1, z2, last = _slope(x, z1, z2, last, k)
            slope = slope if signed else maximum(slope, mul(fall, slope))
            current = mul(ra_gain, slope) if late_reset else fma(ra_gain, slope, w0)
            store(block, to + HALF_LANES, current)
        to, source = to + BLOCK, source + row_bytes
    store(state, z1_at, z1)
    store(state, z2_at, z2)
    store(state, last_at, last)


@inline
def _published_half(block: Any, half: Any, w_at: Any, k: Any, n: Any) -> Any:
    """Advance half a block by a sample in the published order; return the spikes."""
    h, quadratic = broadcast(k[H], HALF_VECTORS), broadcast(k[QUADRATIC], HALF_VECTORS)
    linear, constant = broadcast(k[LINEAR], HALF_VECTORS), broadcast(k[CONSTANT], HALF_VECTORS)
    a_u, b_u = broadcast(k[A_U], HALF_VECTORS), broadcast(k[B_U], HALF_VECTORS)
    u_step, jump = broadcast(k[U_STEP], HALF_VECTORS), broadcast(k[JUMP], HALF_VECTORS)
    threshold, ceiling = broadcast(k[THRESHOLD], HALF_VECTORS), broadcast(k[CEILING], HALF_VECTORS)
    v, u = load(block, half, HALF_VECTORS), load(block, BLOCK_Q + half, HALF_VECTORS)
    w = load(block, w_at, HALF_VECTORS)
    u = select_reached(v, threshold, add(u, jump), u)
    v = select_reached(v, threshold, broadcast(k[RESET_TO], HALF_VECTORS), v)
    for _ in range(n):
        rise = add(add(mul(quadratic, mul(v, v)), mul(linear, v)), constant)
        v = add(v, mul(h, add(sub(rise, u), w)))
    spikes = half_spikes(v, threshold)
    v = select_reached(v, ceiling, ceiling, v)
    store(block, half, v)
    store(block, BLOCK_Q + half, add(u, mul(u_step, mul(a_u, sub(mul(b_u, v), u)))))
    return spikes


@inline
def published_sample(block: Any, w_at: Any, k: Any, n: Any) -> Any:
    """Advance a block by a sample in a scheme that resets at the next one; return the spikes."""
    one = _published_half(block, 0, w_at, k, n)
    return join_halves(one, _published_half(block, HALF_LANES, w_at + HALF_LANES, k, n))


@inline
def copy_half(array: Any, at: Any, block: Any, block_at: Any, save: Any) -> None:
    """Load half a block's numbers from an array into the block's memory, or save them."""
    for i in range(0, HALF_LANES, VECTOR_WIDTH):
        if save:
            store(array, at + i, load(block, block_at + i, 1))
        else:
            store(block, block_at + i, load(array, at + i, 1))


@inline
def carry_state(state: Any, lanes: Any, lane: Any, sa_only: Any, block: Any, save: Any) -> None:
    """Load a block's membranes and recoveries from the state of all lanes, or save them."""
    m, q = M * lanes + lane, Q * lanes + lane
    other_m, other_q = M_RA * lanes + lane, Q_RA * lanes + lane
    if sa_only:
        other_m, other_q = m + HALF_LANES, q + HALF_LANES
    copy_half(state, m, block, 0, save)
    copy_half(state, other_m, block, HALF_LANES, save)
    copy_half(state, q, block, BLOCK_Q, save)
    copy_half(state, other_q, block, BLOCK_Q + HALF_LANES, save)
