"""Decode the taxel board's frames: samples, status, identity, self-test.

:class:`FrameDecoder` returns the same samples however the byte stream is sliced; damaged bytes cost
the frames they touch, repeated and late frames are refused, and every lost sample is counted as a
gap or reported with a reboot.

A chunk is the bytes between two zeros. Frames have four known lengths (that of a data frame follows
from the number of taxels), so that a frame behind lost or added bytes is still found as the tail of
its chunk: garbage costs only the frames it touches.

A counter never runs back within a boot: a data frame at or behind the newest is late or a repeat,
and is refused. Only a status or an identity tells a reboot, by a newer boot count, or by two
statuses in a row that are behind. A data frame that could be of either boot is dropped, and so are
those after it, until the next status.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import (
    CONTROLS,
    DATA,
    IDENTITY,
    JITTER,
    LATE,
    MAX_JUMP,
    OVERHEAD,
    READING_BITS,
    READINGS_AT,
    SELF_TEST_OUTCOME,
    STATUS,
    SelfTest,
    TaxelIdentity,
    TaxelStatus,
    data_body,
    decode_self_test,
)
from rigctl.kernels import inlined, uncounted
from rigctl.values import Block, Gap

_STATUS = struct.Struct("<2xIIHHHBHHHHB")
_IDENTITY = struct.Struct("<xHBBHIBHHBHB")

# Indices into the decoder's state, int64.
REFERENCE, LAST, BOOT_COUNT, DROPS = 0, 1, 2, 3
SYNCHRONISED, DISCARDED, WAITING, PREVIOUS, WITNESS = 4, 5, 6, 7, 8
STATE_SIZE = 9
UNKNOWN = -1
# Why data frames are dropped until a status comes: the stream has just been joined, or a data frame
# may be behind a reboot whose identity was lost.
JOINING, DOUBTING = 1, 2

# What a status or identity tells.
FRESH, REBOOTED, STALE = 0, 1, 2

# Indices into the counts of one call, int64.
N_ROWS, N_GAPS, N_CONTROLS, N_REBOOTS, REJECTED_FRAMES, REJECTED_BYTES, USED = 0, 1, 2, 3, 4, 5, 6
STALE_FRAMES = 7
COUNTS_SIZE = 8

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


def _crc_table() -> NDArray[np.uint32]:
    """Return the CRC of each single byte for zlib's polynomial, without initial and final XOR."""
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(0xEDB88320), table >> 1)
    return table.astype(np.uint32)


CRC_TABLE = _crc_table()


@inlined
def crc32(data: Bytes, length: int) -> Any:
    """Return zlib's CRC-32 of the first ``length`` bytes."""
    crc = np.uint32(0xFFFFFFFF)
    for i in range(length):
        crc = CRC_TABLE[(crc ^ data[i]) & np.uint32(0xFF)] ^ (crc >> np.uint32(8))
    return crc ^ np.uint32(0xFFFFFFFF)


@inlined
def cobs_decode(wire: Bytes, start: int, end: int, out: Bytes) -> int:
    """COBS-decode ``wire[start:end]``, at most 253 bytes without zero; return its length or -1."""
    at, length = start, 0
    while at < end:
        run_end: Any = at + wire[at]
        if run_end > end:
            return -1
        for i in range(at + 1, run_end):
            out[length] = wire[i]
            length += 1
        at = run_end
        if at < end:
            out[length] = 0
            length += 1
    return length


@inlined
def decode_frame(wire: Bytes, start: int, end: int, kind: int, out: Bytes) -> bool:
    """Decode ``wire[start:end]`` into ``out``; return whether it is an intact frame of ``kind``."""
    length = cobs_decode(wire, start, end, out)
    body = end - start - OVERHEAD
    if length != body + 4 or out[0] != kind:
        return False
    crc = np.int64(out[body]) | np.int64(out[body + 1]) << 8
    crc |= np.int64(out[body + 2]) << 16 | np.int64(out[body + 3]) << 24
    return bool(crc == np.int64(crc32(out, body)))


@inlined
def decode_chunk(wire: Bytes, start: int, end: int, data_body: int, out: Bytes) -> int:
    """Decode the frame that ends a chunk into ``out``; return its kind, 0 where there is none."""
    first = end - data_body - OVERHEAD
    if first >= start and decode_frame(wire, first, end, DATA, out):
        return DATA
    for kind, body in CONTROLS:
        first = end - body - OVERHEAD
        if first >= start and decode_frame(wire, first, end, kind, out):
            return kind
    return 0


@inlined
def frame_length(kind: int, data_body: int) -> int:
    """Return the bytes of a frame without its closing zero, 0 for no frame."""
    if kind == DATA:
        return data_body + OVERHEAD
    for control, body in CONTROLS:
        if kind == control:
            return body + OVERHEAD
    return 0


@inlined
def count_rejected(state: Ints, counts: Ints, chunk: int, frame: int) -> None:
    """Count the bytes of a chunk before its frame; a stream that starts mid-frame is no loss."""
    rest = chunk + state[DISCARDED] - frame
    state[DISCARDED] = 0
    if rest > 0 and state[SYNCHRONISED]:
        counts[REJECTED_FRAMES] += 1
        counts[REJECTED_BYTES] += rest
    state[SYNCHRONISED] = 1


@inlined
def little_endian(data: Bytes, at: int, size: int) -> Any:
    """Return the unsigned little-endian integer of ``size`` bytes."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(data[at + i]) << (8 * i)
    return value


@inlined
def unwrap_nearest(reference: int, low_bits: int, modulus: int) -> Any:
    """Return the integer nearest to ``reference`` that equals ``low_bits`` modulo ``modulus``."""
    ahead = (low_bits - reference) % modulus
    return reference + (ahead - modulus if ahead >= modulus // 2 else ahead)


@inlined
def reset_counter(state: Ints, reference: Any) -> None:
    """Restart counting after a reboot of the board."""
    if state[LAST] != UNKNOWN:
        state[PREVIOUS] = state[LAST]
    state[REFERENCE] = reference
    state[LAST] = UNKNOWN
    state[DROPS] = UNKNOWN


@inlined
def unwrap_u32(reference: Any, sent: int) -> Any:
    """Return the unwrapped counter of ``sent``, at most half a turn behind ``reference``."""
    half = np.int64(1) << 31
    counter = (reference & ~np.int64(0xFFFFFFFF)) + sent
    if counter < reference - half:
        return counter + 2 * half
    return counter - 2 * half if counter > reference + half and reference > half else counter


@inlined
def apply_control(body: Bytes, kind: int, state: Ints) -> int:
    """Read counter and boot count of a status or identity; return what it tells."""
    boots = little_endian(body, 17, 2) if kind == STATUS else little_endian(body, 14, 2)
    newer = (boots - state[BOOT_COUNT]) % (1 << 16) if state[BOOT_COUNT] != UNKNOWN else 0
    counter = np.int64(0)
    behind = newer >= 1 << 15
    if kind == STATUS:
        sent = little_endian(body, 2, 4)
        counter = sent if newer else unwrap_u32(state[REFERENCE], sent)
        behind = behind or (newer == 0 and counter < state[REFERENCE] - JITTER)
    if behind and state[WAITING] != JOINING and not is_second_behind(state, kind, counter):
        return STALE
    state[BOOT_COUNT] = boots
    rebooted = newer != 0 or behind
    if rebooted:
        reset_counter(state, counter)
    if kind == STATUS:
        state[WITNESS] = UNKNOWN
        state[REFERENCE] = max(state[REFERENCE], counter)
    told = kind == STATUS and (state[WAITING] == JOINING or counter > state[LAST])
    if told or (rebooted and state[WAITING] == DOUBTING):
        state[WAITING] = 0
    return REBOOTED if rebooted else FRESH


@inlined
def is_second_behind(state: Ints, kind: int, counter: Any) -> bool:
    """Return whether this status runs on from another one that was behind: the board rebooted."""
    before = state[WITNESS]
    if kind == STATUS:
        state[WITNESS] = counter
    return bool(kind == STATUS and before != UNKNOWN and counter > before)


@inlined
def unpack_samples(body: Bytes, samples: NDArray[np.uint16], row: int, order: Ints) -> None:
    """Unpack 10 bit a taxel, LSB first, into the columns of ``samples`` that ``order`` names."""
    for i in range(samples.shape[1]):
        samples[row, i] = bits_at(body, READING_BITS * order[i]) & np.uint32(0x3FF)


@inlined
def bits_at(body: Bytes, bit: int) -> Any:
    """Return the bits from one of the readings' bits on, uint32, at least ten."""
    at = READINGS_AT + (bit >> 3)
    pair = np.uint32(body[at]) | np.uint32(body[at + 1]) << np.uint32(8)
    return pair >> np.uint32(bit & 7)


@njit(cache=True)
def decode_wire(
    wire: Bytes,
    state: Ints,
    counters: Ints,
    samples: NDArray[np.uint16],
    marks: Bytes,
    notes: Ints,
    controls: Bytes,
    counts: Ints,
    body: Bytes,
    data_body: int,
    order: Ints,
) -> None:
    """Decode every complete chunk of ``wire``, its first ``counts[USED]`` bytes.

    ``body``: memory for the longest frame. ``data_body``: bytes in the body of a data frame.
    ``order``: the reading in each column of ``samples``. ``marks``, uint8 (2, n): flags, edge
    counts. ``notes``, int64 (n, 5): row, first lost counter, count, frames that the board reports
    as dropped; column 4: first row of each boot.
    """
    wire, state = uncounted(wire), uncounted(state)
    counts, body = uncounted(counts), uncounted(body)
    counters, samples, marks = uncounted(counters), uncounted(samples), uncounted(marks)
    notes, controls, order = uncounted(notes), uncounted(controls), uncounted(order)
    counts[:] = 0
    for end in range(wire.shape[0]):
        if wire[end] != 0:
            continue
        start = counts[USED]
        kind = decode_chunk(wire, start, end, data_body, body)
        count_rejected(state, counts, end - start, frame_length(kind, data_body))
        counts[USED] = end + 1
        if kind == DATA and not state[WAITING]:
            append_sample(body, state, counters, samples, marks, notes, counts, order)
        elif kind in (STATUS, IDENTITY, SELF_TEST_OUTCOME):
            controls[counts[N_CONTROLS]] = body
            counts[N_CONTROLS] += 1
            told = apply_control(body, kind, state) if kind != SELF_TEST_OUTCOME else FRESH
            if told == REBOOTED:
                record_reboot(notes, counts)
            elif told == STALE:
                counts[N_CONTROLS] -= 1
                counts[STALE_FRAMES] += 1


@inlined
def append_sample(
    body: Bytes,
    state: Ints,
    counters: Ints,
    samples: NDArray[np.uint16],
    marks: Bytes,
    notes: Ints,
    counts: Ints,
    order: Ints,
) -> None:
    """Append a data frame as the next row, after a gap, unless it is late or doubtful."""
    row = counts[N_ROWS]
    sequence = little_endian(body, 1, 2)
    first_ever = state[LAST] == UNKNOWN and state[REFERENCE] == 0 and state[PREVIOUS] == UNKNOWN
    counter = sequence if first_ever else unwrap_nearest(state[REFERENCE], sequence, 1 << 16)
    if is_late(state, counter, sequence):
        counts[STALE_FRAMES] += 1
        return
    if not first_ever and is_doubtful(state, counter):
        state[WAITING] = DOUBTING
        return
    counters[row] = counter
    unpack_samples(body, samples, row, order)
    marks[0, row] = body[3]
    marks[1, row] = bits_at(body, READING_BITS * samples.shape[1]) & np.uint32(0xF)
    record_gap(state, counter, np.int64(body[3] >> 4), notes, counts)
    state[REFERENCE] = max(state[REFERENCE], counter)
    state[LAST] = counter
    counts[N_ROWS] += 1


@inlined
def is_late(state: Ints, counter: Any, sequence: int) -> bool:
    """Return whether a data frame repeats the newest, or comes behind newer ones or a reboot."""
    if state[LAST] != UNKNOWN:
        return bool(counter <= state[LAST])
    if state[PREVIOUS] == UNKNOWN or sequence < LATE:
        return False
    return bool((sequence - state[PREVIOUS] + LATE) % (1 << 16) <= 2 * LATE)


@inlined
def is_doubtful(state: Ints, counter: Any) -> bool:
    """Return whether a data frame may be of another boot, or too far ahead to unwrap.

    A gap across the wrap of the 16 bits looks like a reboot, whose counter begins at 0.
    """
    ahead = counter - state[REFERENCE]
    if state[LAST] == UNKNOWN:
        return bool(counter < 0 or ahead < -JITTER or ahead > MAX_JUMP)
    wraps = counter >> 16 != state[REFERENCE] >> 16
    return bool(ahead > MAX_JUMP or (ahead > 1 and wraps))


@inlined
def record_reboot(notes: Ints, counts: Ints) -> None:
    """Record that counting restarts with the next row."""
    notes[counts[N_REBOOTS], 4] = counts[N_ROWS]
    counts[N_REBOOTS] += 1


@inlined
def record_gap(state: Ints, counter: Any, drops: Any, notes: Ints, counts: Ints) -> None:
    """Record the samples lost since the last data frame, and how many the board dropped."""
    if state[LAST] != UNKNOWN and counter > state[LAST] + 1:
        gap = counts[N_GAPS]
        notes[gap, 0] = counts[N_ROWS]
        notes[gap, 1] = state[LAST] + 1
        notes[gap, 2] = counter - state[LAST] - 1
        notes[gap, 3] = drops - state[DROPS] if state[DROPS] >= 0 else 0
        counts[N_GAPS] += 1
    state[DROPS] = drops


class Decoded(NamedTuple):
    """Contents of one slice of the byte stream.

    ``blocks``: the samples in order, in one block and another after each reboot, because the
    board's counters restart; between two blocks' first and last sample, each counter is either a
    row or in a gap. ``reboots`` counts reboots, ``rejected_frames`` and ``rejected_bytes`` what was
    no intact frame, ``stale_frames`` intact ones that repeat or come behind newer ones.
    """

    blocks: tuple[Block, ...]
    statuses: tuple[TaxelStatus, ...]
    identities: tuple[TaxelIdentity, ...]
    self_tests: tuple[SelfTest, ...]
    reboots: int
    rejected_frames: int
    rejected_bytes: int
    stale_frames: int


class FrameDecoder:
    """Decodes the byte stream of a board with ``n_taxels``, in slices of any length.

    ``order``: the reading of each taxel on the wire, its own number where left out.
    Call :meth:`resync` to join a running stream: a data frame holds only the low 16 bits of the
    sample counter, a status frame all of them.
    """

    def __init__(self, n_taxels: int, order: Sequence[int] | None = None) -> None:
        self._tail = b""
        self._n_taxels = n_taxels
        self._order = np.array(range(n_taxels) if order is None else order, np.int64)
        self._data_body = data_body(n_taxels)
        bodies = self._data_body, *(body for _, body in CONTROLS)
        self._min_chunk = min(bodies) + OVERHEAD + 1
        self._max_chunk = max(bodies) + OVERHEAD
        self._state = np.zeros(STATE_SIZE, np.int64)
        unknown = [LAST, BOOT_COUNT, DROPS]
        unknown += [PREVIOUS, WITNESS]
        self._state[unknown] = UNKNOWN
        self._counts = np.zeros(COUNTS_SIZE, np.int64)
        self._body = np.zeros(self._max_chunk, np.uint8)
        self._allocate(16)
        # Loads the compiled kernel now: later it would delay a heartbeat.
        self.feed(b"", 0.0)

    def resync(self) -> None:
        """Restart after an interruption: wait for a status frame, then count the lost samples."""
        self._tail = b""
        self._state[[SYNCHRONISED, DISCARDED]] = 0
        self._state[WITNESS] = UNKNOWN
        self._state[WAITING] = JOINING

    @property
    def waiting(self) -> bool:
        """True from :meth:`resync`, or a gap that may hide a reboot, to the next status frame.

        Data frames are dropped and counted in the next gap.
        """
        return bool(self._state[WAITING])

    def feed(self, data: bytes, at_s: float) -> Decoded:
        """Decode bytes that arrived at loop time ``at_s``."""
        wire = np.frombuffer(self._tail + data, np.uint8)
        capacity = wire.shape[0] // self._min_chunk + 1
        if capacity > self._notes.shape[0]:
            self._allocate(capacity)
        counters = np.empty(capacity, np.int64)
        samples = np.empty((capacity, self._n_taxels), np.uint16)
        marks = np.empty((2, capacity), np.uint8)
        decode_wire(
            wire,
            self._state,
            counters,
            samples,
            marks,
            self._notes,
            self._controls,
            self._counts,
            self._body,
            self._data_body,
            self._order,
        )
        rows, gaps, controls, reboots, frames, bytes_, used, stale = self._counts.tolist()
        self._set_tail(wire, used)
        cuts = [0, *self._notes[:reboots, 4].tolist(), rows] if reboots else [0, rows]
        blocks = [
            Block(
                counters[first:end],
                samples[first:end],
                marks[0, first:end],
                marks[1, first:end],
                self._gaps(gaps, first, end) if gaps else (),
                at_s,
            )
            for first, end in pairwise(cuts)
            if end > first
        ]
        control_frames = self._decode_controls(controls) if controls else ((), (), ())
        return Decoded(tuple(blocks), *control_frames, reboots, frames, bytes_, stale)

    def _allocate(self, capacity: int) -> None:
        self._notes = np.empty((capacity, 5), np.int64)
        self._controls = np.empty((capacity, self._max_chunk), np.uint8)

    def _set_tail(self, wire: NDArray[np.uint8], used: int) -> None:
        """Keep the unfinished chunk; of an endless one, no more than can end in a frame."""
        surplus = wire.shape[0] - used - 2 * self._max_chunk
        if surplus > 0:
            self._state[DISCARDED] += surplus
            used += surplus
        self._tail = wire[used:].tobytes()

    def _gaps(self, n_gaps: int, first: int, end: int) -> tuple[Gap, ...]:
        notes = self._notes[:n_gaps, :4].tolist()
        return tuple(
            Gap(at, count, "dropped by the board" if dropped > 0 else "lost on the line")
            for row, at, count, dropped in notes
            if first <= row < end
        )

    def _decode_controls(
        self, n: int
    ) -> tuple[tuple[TaxelStatus, ...], tuple[TaxelIdentity, ...], tuple[SelfTest, ...]]:
        statuses, identities, tests = [], [], []
        for body in map(bytes, self._controls[:n]):
            if body[0] == STATUS:
                statuses.append(TaxelStatus(*_STATUS.unpack_from(body)))
            elif body[0] == IDENTITY:
                identities.append(TaxelIdentity(*_IDENTITY.unpack_from(body)))
            else:
                tests.append(decode_self_test(body))
        return tuple(statuses), tuple(identities), tuple(tests)
