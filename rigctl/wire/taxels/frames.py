"""The taxel board's wire: bytes to blocks, status and identity, and back.

The layout stands in ``docs/reference/taxel-wire.md``. :class:`FrameDecoder` takes any slices of
the byte stream and gives the same samples; damaged bytes cost the frames they touch, and every
lost sample is counted as a gap or reported with a reboot.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import KW_ONLY, dataclass
from enum import IntFlag
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.values import N_TAXELS, Block, Gap
from rigctl.wire.drum.register_table import BOARD_TAXELS, MAGIC
from rigctl.wire.taxels import cobs, kernels
from rigctl.wire.taxels.self_test import SelfTest, encode_tested, parse_tested

WIRE_VERSION = 2
BAUD = 500_000
FRAME_BYTES = kernels.LONGEST_CHUNK + 1
STATUS_EVERY = 100
CYCLES_PER_US = 16
"""Of the board's chip: what its longest interrupt is counted in."""
IDENTIFY, SELF_TEST = 0x01, 0x02
DROPS_SHIFT, DROPS_MOST = 4, 15
SHORTEST_CHUNK = kernels.TESTED_BODY + kernels.OVERHEAD + 1
TAIL_KEPT = 2 * kernels.LONGEST_CHUNK

_STATUS = struct.Struct("<BBIIHHHBHHHHB")
_IDENTITY = struct.Struct("<BHBBHIBHHBHB")


class SelfTestBit(IntFlag):
    """Bits of :attr:`TaxelStatus.self_test_bits`."""

    DONE = 1
    FOUND = 2
    RUNNING = 4


class Flag(IntFlag):
    """Low bits of a data frame's flags; bits 4–7 count dropped frames, saturating at 15."""

    SYNC = 1
    INDEX = 2
    LATE = 4
    OVERRUN = 8


@dataclass(frozen=True, slots=True)
class TaxelStatus:
    """What the taxel board says about itself ten times a second."""

    sample_counter: int
    frames_dropped: int
    late_slots: int
    longest_isr_cycles: int
    supply_mv: int
    reset_cause: int
    boot_count: int
    free_stack_bytes: int
    idle_permille: int
    sync_rises: int
    self_test_bits: int
    _: KW_ONLY
    version: int = WIRE_VERSION


@dataclass(frozen=True, slots=True)
class TaxelIdentity:
    """Who the taxel board says it is."""

    firmware_version: int
    build_hash: int
    boot_count: int
    reset_cause: int
    magic: int = MAGIC
    wire_version: int = WIRE_VERSION
    board_id: int = BOARD_TAXELS
    n_taxels: int = N_TAXELS
    rate_hz: int = 1000
    slot_cycles: int = 800
    slots: int = 20


class Decoded(NamedTuple):
    """What one piece of the byte stream held.

    ``blocks``: samples in order, one block; a new one begins where the board rebooted, because
    its counters start anew there. ``reboots``: how often that happened.
    ``rejected_frames``, ``rejected_bytes``: what was no whole frame, in this piece.
    """

    blocks: tuple[Block, ...]
    statuses: tuple[TaxelStatus, ...]
    identities: tuple[TaxelIdentity, ...]
    self_tests: tuple[SelfTest, ...]
    reboots: int
    rejected_frames: int
    rejected_bytes: int

    @property
    def block(self) -> Block | None:
        """The newest samples, None where the piece completed no data frame."""
        return self.blocks[-1] if self.blocks else None


def frame(body: bytes) -> bytes:
    """``body`` with its CRC-32, stuffed, and the closing zero."""
    return cobs.encode(body + zlib.crc32(body).to_bytes(4, "little")) + b"\0"


def unframe(chunk: bytes) -> bytes | None:
    """Body of what stood between two zero bytes; None where it is damaged or empty."""
    try:
        data = cobs.decode(chunk)
    except ValueError:
        return None
    body, crc = data[:-4], data[-4:]
    return body if body and zlib.crc32(body).to_bytes(4, "little") == crc else None


def encode_request(kind: int) -> bytes:
    """A request of the host to the board: IDENTIFY or SELF_TEST."""
    return frame(bytes([kind]))


def encode_data(
    counters: NDArray[np.int64],
    samples: NDArray[np.uint16],
    flags: NDArray[np.uint8],
    edges: NDArray[np.uint8],
) -> bytes:
    """Data frames of n samples; the arrays are those of :class:`rigctl.values.Block`."""
    wire = np.empty((counters.shape[0], FRAME_BYTES), np.uint8)
    kernels.encode_rows(counters, samples, flags, edges, wire)
    return wire.tobytes()


def encode_status(status: TaxelStatus) -> bytes:
    """One status frame."""
    s = status
    return frame(
        _STATUS.pack(
            kernels.STATUS,
            s.version,
            s.sample_counter & 0xFFFFFFFF,
            s.frames_dropped & 0xFFFFFFFF,
            s.late_slots,
            s.longest_isr_cycles,
            s.supply_mv,
            s.reset_cause,
            s.boot_count,
            s.free_stack_bytes,
            s.idle_permille,
            s.sync_rises & 0xFFFF,
            s.self_test_bits,
        )
    )


def encode_identity(identity: TaxelIdentity) -> bytes:
    """One identity frame."""
    i = identity
    return frame(
        _IDENTITY.pack(
            kernels.IDENTITY,
            i.magic,
            i.wire_version,
            i.board_id,
            i.firmware_version,
            i.build_hash,
            i.n_taxels,
            i.rate_hz,
            i.boot_count,
            i.reset_cause,
            i.slot_cycles,
            i.slots,
        )
    )


def encode_self_test(test: SelfTest) -> bytes:
    """One frame with the outcome of a self-test."""
    return frame(bytes([kernels.TESTED, WIRE_VERSION]) + encode_tested(test))


def parse_status(body: bytes) -> TaxelStatus:
    """The status that :func:`encode_status` was given."""
    _, version, *rest = _STATUS.unpack_from(body)
    return TaxelStatus(*rest, version=version)


def parse_identity(body: bytes) -> TaxelIdentity:
    """The identity that :func:`encode_identity` was given."""
    _, magic, wire, board, firmware, build, taxels, rate, boots, cause, cycles, slots = (
        _IDENTITY.unpack_from(body)
    )
    return TaxelIdentity(
        firmware, build, boots, cause, magic, wire, board, taxels, rate, cycles, slots
    )


class FrameDecoder:
    """The board's byte stream to blocks, in whatever slices it arrives.

    A decoder that joins a running stream is told so by :meth:`resync`: the data frames carry
    only the low 16 bits of the sample counter, a status frame all of them.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._state = np.zeros(kernels.STATE_SIZE, np.int64)
        self._state[[kernels.LAST, kernels.BOOT_COUNT, kernels.DROPS]] = kernels.NOTHING_YET
        self._tally = np.zeros(kernels.TALLY_SIZE, np.int64)
        self._make_room(16)
        # Loads the compiled kernel now: later it would hold up a loop that hears a heartbeat.
        self.feed(b"", 0.0)

    def resync(self) -> None:
        """The stream was interrupted: wait for a status frame, then count what was lost."""
        self._rest = b""
        self._state[[kernels.SYNCHRONISED, kernels.CARRIED]] = 0
        self._state[kernels.WAITING] = 1

    @property
    def waiting(self) -> bool:
        """True until the status frame after :meth:`resync` came; data is held back."""
        return bool(self._state[kernels.WAITING])

    def feed(self, data: bytes, at_s: float) -> Decoded:
        """Decode the bytes that arrived at loop time ``at_s``."""
        wire = np.frombuffer(self._rest + data, np.uint8)
        room = wire.shape[0] // SHORTEST_CHUNK + 1
        if room > self._notes.shape[0]:
            self._make_room(room)
        counters = np.empty(room, np.int64)
        samples = np.empty((room, N_TAXELS), np.uint16)
        marks = np.empty((2, room), np.uint8)
        kernels.decode_wire(
            wire, self._state, counters, samples, marks, self._notes, self._controls, self._tally
        )
        rows, gaps, controls, reboots, frames, junk, used = self._tally.tolist()
        self._keep(wire, used)
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
        said = self._said(controls) if controls else ((), (), ())
        return Decoded(tuple(blocks), *said, reboots, frames, junk)

    def _make_room(self, room: int) -> None:
        self._notes = np.empty((room, 5), np.int64)
        self._controls = np.empty((room, kernels.LONGEST_CHUNK), np.uint8)

    def _keep(self, wire: NDArray[np.uint8], used: int) -> None:
        """Keep the unfinished chunk, of an endless one no more than can end in a frame."""
        surplus = wire.shape[0] - used - TAIL_KEPT
        if surplus > 0:
            self._state[kernels.CARRIED] += surplus
            used += surplus
        self._rest = wire[used:].tobytes()

    def _gaps(self, n_gaps: int, first: int, end: int) -> tuple[Gap, ...]:
        notes = self._notes[:n_gaps, :4].tolist()
        return tuple(
            Gap(at, count, "dropped by the board" if dropped > 0 else "lost on the line")
            for row, at, count, dropped in notes
            if first <= row < end
        )

    def _said(
        self, n: int
    ) -> tuple[tuple[TaxelStatus, ...], tuple[TaxelIdentity, ...], tuple[SelfTest, ...]]:
        bodies = [body.tobytes() for body in self._controls[:n]]
        statuses = [parse_status(b) for b in bodies if b[0] == kernels.STATUS]
        identities = [parse_identity(b) for b in bodies if b[0] == kernels.IDENTITY]
        tests = [parse_tested(b[2:]) for b in bodies if b[0] == kernels.TESTED]
        return tuple(statuses), tuple(identities), tuple(tests)
