"""The compiled inner loops of the taxel wire; :mod:`rigctl.wire.taxels.frames` gives them meaning.

A chunk is what stands between two zero bytes. Frames have four known lengths, so where bytes
were lost or added in front of a frame, the frame is still found as the tail of its chunk:
garbage costs only the frames it touches. Nothing here allocates or raises.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

IDENTITY, DATA, STATUS, TESTED = 0x10, 0x11, 0x12, 0x13
DATA_BODY, STATUS_BODY, IDENTITY_BODY, TESTED_BODY = 27, 26, 20, 18
OVERHEAD = 5
"""Bytes that CRC-32 and COBS add to a body; the closing zero comes on top."""
LONGEST_CHUNK = DATA_BODY + OVERHEAD
N_READINGS = 18

# Places in the decoder's state, int64.
REFERENCE, LAST, BOOT_COUNT, DROPS = 0, 1, 2, 3
SYNCHRONISED, CARRIED, WAITING = 4, 5, 6
STATE_SIZE = 7
NOTHING_YET = -1
JITTER = 50
"""Samples by which a status frame may lag behind the data frames around it."""

# Places in the tally of one call, int64.
N_ROWS, N_GAPS, N_CONTROLS, N_REBOOTS, REJECTED_FRAMES, REJECTED_BYTES, USED = 0, 1, 2, 3, 4, 5, 6
TALLY_SIZE = 7

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


def _crc_table() -> NDArray[np.uint32]:
    """CRC of each single byte without start and final XOR, from zlib's polynomial."""
    table = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        table = np.where(table & 1, (table >> 1) ^ np.uint32(0xEDB88320), table >> 1)
    return table.astype(np.uint32)


CRC_TABLE = _crc_table()


@njit(cache=True)
def crc32(data: Bytes, length: int) -> Any:
    """zlib's CRC-32 of the first ``length`` bytes."""
    crc = np.uint32(0xFFFFFFFF)
    for i in range(length):
        crc = CRC_TABLE[(crc ^ data[i]) & np.uint32(0xFF)] ^ (crc >> np.uint32(8))
    return crc ^ np.uint32(0xFFFFFFFF)


@njit(cache=True)
def unstuff(wire: Bytes, start: int, end: int, out: Bytes) -> int:
    """COBS-decode ``wire[start:end]``, at most 253 bytes without zero; length, or -1."""
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


@njit(cache=True)
def body_at(wire: Bytes, start: int, end: int, kind: int, out: Bytes) -> bool:
    """True where ``wire[start:end]`` is one whole frame of ``kind``; its body is in ``out``."""
    length = unstuff(wire, start, end, out)
    body = end - start - OVERHEAD
    if length != body + 4 or out[0] != kind:
        return False
    crc = np.int64(out[body]) | np.int64(out[body + 1]) << 8
    crc |= np.int64(out[body + 2]) << 16 | np.int64(out[body + 3]) << 24
    return bool(crc == np.int64(crc32(out, body)))


@njit(cache=True)
def frame_in(wire: Bytes, start: int, end: int, out: Bytes) -> int:
    """Kind of the frame that ends a chunk, its body in ``out``; 0 where there is none."""
    for kind, body in (
        (DATA, DATA_BODY),
        (STATUS, STATUS_BODY),
        (IDENTITY, IDENTITY_BODY),
        (TESTED, TESTED_BODY),
    ):
        first = end - body - OVERHEAD
        if first >= start and body_at(wire, first, end, kind, out):
            return kind
    return 0


@njit(cache=True)
def encoded_length(kind: int) -> int:
    """Wire bytes of a frame without its closing zero; 0 for no frame."""
    if kind == DATA:
        return DATA_BODY + OVERHEAD
    if kind == STATUS:
        return STATUS_BODY + OVERHEAD
    if kind == TESTED:
        return TESTED_BODY + OVERHEAD
    return IDENTITY_BODY + OVERHEAD if kind == IDENTITY else 0


@njit(cache=True)
def count_rejected(state: Ints, tally: Ints, chunk: int, kind: int) -> None:
    """Count what a chunk held beside its frame; a start in mid-frame is not a loss."""
    rest = chunk + state[CARRIED] - encoded_length(kind)
    state[CARRIED] = 0
    if rest > 0 and state[SYNCHRONISED]:
        tally[REJECTED_FRAMES] += 1
        tally[REJECTED_BYTES] += rest
    state[SYNCHRONISED] = 1


@njit(cache=True)
def little(data: Bytes, at: int, size: int) -> Any:
    """Unsigned little-endian integer of ``size`` bytes."""
    value = np.int64(0)
    for i in range(size):
        value |= np.int64(data[at + i]) << (8 * i)
    return value


@njit(cache=True)
def nearest(reference: int, low_bits: int, modulus: int) -> Any:
    """The integer nearest to ``reference`` that equals ``low_bits`` modulo ``modulus``."""
    ahead = (low_bits - reference) % modulus
    return reference + (ahead - modulus if ahead >= modulus // 2 else ahead)


@njit(cache=True)
def restart(state: Ints, reference: Any) -> None:
    """Begin to count anew: the board rebooted."""
    state[REFERENCE] = reference
    state[LAST] = NOTHING_YET
    state[DROPS] = NOTHING_YET


@njit(cache=True)
def unwrap_u32(reference: Any, sent: int) -> Any:
    """The counter that ``sent`` stands for, not more than half a turn behind ``reference``."""
    half = np.int64(1) << 31
    counter = (reference & ~np.int64(0xFFFFFFFF)) + sent
    if counter < reference - half:
        return counter + 2 * half
    return counter - 2 * half if counter > reference + half and reference > half else counter


@njit(cache=True)
def control(body: Bytes, kind: int, state: Ints) -> bool:
    """Take counter and boot count from a status or identity body; True for a reboot."""
    boots = little(body, 17, 2) if kind == STATUS else little(body, 14, 2)
    rebooted = state[BOOT_COUNT] != NOTHING_YET and boots != state[BOOT_COUNT]
    state[BOOT_COUNT] = boots
    counter = np.int64(0)
    if kind == STATUS:
        sent = little(body, 2, 4)
        counter = sent if rebooted else unwrap_u32(state[REFERENCE], sent)
        rebooted = rebooted or counter < state[REFERENCE] - JITTER
        state[REFERENCE] = max(state[REFERENCE], counter)
        state[WAITING] = 0
    if rebooted:
        restart(state, counter)
    return bool(rebooted)


@njit(cache=True)
def unpack_readings(body: Bytes, samples: NDArray[np.uint16], row: int) -> None:
    """18 × 10 bit, LSB first, from body byte 4 on."""
    for i in range(N_READINGS):
        at = 4 + (10 * i >> 3)
        pair = np.uint32(body[at]) | np.uint32(body[at + 1]) << np.uint32(8)
        samples[row, i] = (pair >> np.uint32(10 * i & 7)) & np.uint32(0x3FF)


@njit(cache=True)
def decode_wire(
    wire: Bytes,
    state: Ints,
    counters: Ints,
    samples: NDArray[np.uint16],
    marks: Bytes,
    notes: Ints,
    controls: Bytes,
    tally: Ints,
) -> None:
    """Decode every whole chunk of ``wire``; ``tally[USED]`` bytes are done with.

    ``marks``, uint8 (2, n): flags, edge counts. ``notes``, int64 (n, 5): row, first lost
    counter, count, frames the board says it dropped; column 4: first row of each new boot.
    """
    body = np.empty(LONGEST_CHUNK, np.uint8)
    tally[:] = 0
    for end in range(wire.shape[0]):
        if wire[end] != 0:
            continue
        start = tally[USED]
        kind = frame_in(wire, start, end, body)
        count_rejected(state, tally, end - start, kind)
        tally[USED] = end + 1
        if kind == DATA and not state[WAITING]:
            take_data(body, state, counters, samples, marks, notes, tally)
        elif kind in (STATUS, IDENTITY, TESTED):
            controls[tally[N_CONTROLS]] = body
            tally[N_CONTROLS] += 1
            if kind != TESTED and control(body, kind, state):
                note_reboot(notes, tally)


@njit(cache=True)
def take_data(
    body: Bytes,
    state: Ints,
    counters: Ints,
    samples: NDArray[np.uint16],
    marks: Bytes,
    notes: Ints,
    tally: Ints,
) -> None:
    """One data frame into the next row, with the gap or the reboot that shows before it."""
    row = tally[N_ROWS]
    sequence = little(body, 1, 2)
    first_ever = state[LAST] == NOTHING_YET and state[REFERENCE] == 0
    counter = sequence if first_ever else nearest(state[REFERENCE], sequence, 1 << 16)
    if state[LAST] != NOTHING_YET and counter <= state[LAST]:
        counter = sequence
        restart(state, counter)
        note_reboot(notes, tally)
    counters[row] = counter
    unpack_readings(body, samples, row)
    marks[0, row] = body[3]
    marks[1, row] = body[26] >> 4
    note_gap(state, counter, np.int64(body[3] >> 4), notes, tally)
    state[REFERENCE] = max(state[REFERENCE], counter)
    state[LAST] = counter
    tally[N_ROWS] += 1


@njit(cache=True)
def note_reboot(notes: Ints, tally: Ints) -> None:
    """Write down that counting starts anew with the next row."""
    notes[tally[N_REBOOTS], 4] = tally[N_ROWS]
    tally[N_REBOOTS] += 1


@njit(cache=True)
def note_gap(state: Ints, counter: Any, drops: Any, notes: Ints, tally: Ints) -> None:
    """Write down the samples lost since the last data frame, and how many the board dropped."""
    if state[LAST] != NOTHING_YET and counter > state[LAST] + 1:
        gap = tally[N_GAPS]
        notes[gap, 0] = tally[N_ROWS]
        notes[gap, 1] = state[LAST] + 1
        notes[gap, 2] = counter - state[LAST] - 1
        notes[gap, 3] = drops - state[DROPS] if state[DROPS] >= 0 else 0
        tally[N_GAPS] += 1
    state[DROPS] = drops


@njit(cache=True)
def encode_rows(
    counters: Ints, samples: NDArray[np.uint16], flags: Bytes, edges: Bytes, wire: Bytes
) -> None:
    """Data frames of ``counters`` into ``wire``, uint8 (n, 33)."""
    body = np.empty(DATA_BODY + 4, np.uint8)
    for row in range(counters.shape[0]):
        body[:] = 0
        body[0] = DATA
        body[1] = counters[row] & 0xFF
        body[2] = counters[row] >> 8 & 0xFF
        body[3] = flags[row]
        for i in range(N_READINGS):
            value = np.uint32(samples[row, i] & 0x3FF) << np.uint32(10 * i & 7)
            body[4 + (10 * i >> 3)] |= value & 0xFF
            body[5 + (10 * i >> 3)] |= value >> 8 & 0xFF
        body[26] |= (edges[row] & 0xF) << 4
        crc = np.int64(crc32(body, DATA_BODY))
        for i in range(4):
            body[DATA_BODY + i] = crc >> (8 * i) & 0xFF
        stuff(body, wire, row)


@njit(cache=True)
def stuff(body: Bytes, wire: Bytes, row: int) -> None:
    """COBS-encode ``body``, at most 253 bytes, and its closing zero into one row of ``wire``."""
    code_at = 0
    for i in range(body.shape[0]):
        if body[i] == 0:
            wire[row, code_at] = i + 1 - code_at
            code_at = i + 1
        else:
            wire[row, i + 1] = body[i]
    wire[row, code_at] = body.shape[0] + 1 - code_at
    wire[row, body.shape[0] + 1] = 0
