"""Decode the finger board's byte stream, in slices of any length."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Iterable
from enum import Enum
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import JITTER, LATE, MAX_JUMP
from rigctl.finger.board_messages import (
    DATA_TYPE,
    N_TAXELS,
    REPORT_TYPES,
    FingerIdentity,
    FingerStatus,
    Message,
    decode_message,
)

_LOW, _WHOLE = 1 << 16, 1 << 32


class Placing(Enum):
    """What becomes of data frames: placed, or dropped until a status tells the whole counter."""

    PLACED = "placed"
    JOINING = "joining"
    DOUBTING = "doubting"


class PlacedRows(NamedTuple):
    """Rows of a run that are new, k of them, their whole counters int64 (k,), and how many lack
    before or between them."""

    rows: NDArray[np.int64] | slice
    counters: NDArray[np.int64]
    missing: int


class SampleCounter:
    """Places data frames by what statuses say; a counter never runs back until a reboot.

    A frame at or behind the newest is late or a repeat. One that may be behind a reboot, or too
    far ahead for 16 bits, is dropped, and so are those after it, until the next status. The counter
    survives a reconnect of a board that kept running: the samples in between are missing.
    """

    def __init__(self) -> None:
        self.placing = Placing.PLACED
        self.stale = 0
        """Data frames that repeat the newest or come behind it."""
        self._last: int | None = None
        self._reference: int | None = None
        self._witness: int | None = None
        self._previous: int | None = None
        """Newest counter of the boot before."""

    def join(self) -> None:
        """Join a stream: the next status tells the whole counter."""
        self.placing = Placing.JOINING
        self._witness = None

    def begin(self) -> bool:
        """Begin at 0 with an identity sent at boot; False for one that the board has sent before.

        A board takes longer than ``JITTER`` samples to boot.
        """
        if self._reference is not None and self._reference < JITTER:
            return False
        self._restart()
        self._reference = 0
        self.placing = Placing.PLACED
        return True

    def tell(self, samples: int, connecting: bool) -> bool:
        """Take the count of samples from a status; return whether it tells a reboot.

        A status behind the samples does while ``connecting``. Later, the first is late; a second
        that runs on from it is that of a board that began again.
        """
        newest = samples - 1
        if self._reference is not None:
            newest = _nearest(self._reference, newest, _WHOLE)
        behind = self._is_behind(newest)
        if (behind and not connecting) or self._is_of_boot_before(newest):
            before, self._witness = self._witness, newest
            if before is None or newest <= before:
                return False
        if behind:
            self._restart()
            newest = samples - 1
        self._accept(newest)
        return behind

    def place(self, low: NDArray[np.int64]) -> PlacedRows:
        """Return the rows to keep of a run of data frames, from their low 16 bits int64 (n,)."""
        if self.placing is not Placing.PLACED or not len(low):
            return _NO_ROWS
        if self._last is not None:
            counters = np.arange(self._last + 1, self._last + 1 + len(low))
            if (low == counters & 0xFFFF).all():
                self._last += len(low)
                self._reference = max(self._last, self._reference or 0)
                return PlacedRows(_ALL, counters, 0)
        return self._place_each(low.tolist())

    def _place_each(self, low: list[int]) -> PlacedRows:
        rows: list[int] = []
        counters: list[int] = []
        first = self._last
        for row, sent in enumerate(low):
            counter = sent if self._reference is None else _nearest(self._reference, sent, _LOW)
            if self._is_late(counter, sent):
                self.stale += 1
            elif self._is_doubtful(counter):
                self.placing = Placing.DOUBTING
                break
            else:
                rows.append(row)
                counters.append(counter)
                self._last = counter
                self._reference = max(counter, self._reference or 0)
        if not counters:
            return _NO_ROWS
        before = counters[0] - 1 if first is None else first
        missing = counters[-1] - before - len(counters)
        return PlacedRows(np.array(rows, np.int64), np.array(counters, np.int64), missing)

    def _restart(self) -> None:
        self._previous = self._previous if self._last is None else self._last
        self._last = self._reference = self._witness = None

    def _is_late(self, counter: int, sent: int) -> bool:
        if self._last is not None:
            return counter <= self._last
        if self._previous is None or sent < LATE:
            return False
        return (sent - self._previous + LATE) % _LOW <= 2 * LATE

    def _is_doubtful(self, counter: int) -> bool:
        """A gap across the wrap of the 16 bits looks like a reboot, whose counter begins at 0."""
        if self._reference is None:
            return False
        ahead = counter - self._reference
        if self._last is None:
            return not (-JITTER <= ahead <= MAX_JUMP and counter >= 0)
        return ahead > MAX_JUMP or (ahead > 1 and counter // _LOW != self._reference // _LOW)

    def _is_behind(self, newest: int) -> bool:
        if self.placing is Placing.JOINING:
            return self._last is not None and newest < self._last
        return self._reference is not None and newest < self._reference - JITTER

    def _is_of_boot_before(self, newest: int) -> bool:
        """Return whether a board that has just begun cannot have taken so many samples."""
        return self._last is None and self._reference == 0 and newest > MAX_JUMP

    def _accept(self, newest: int) -> None:
        self._witness = None
        self._reference = max(newest, self._reference or 0)
        if self.placing is Placing.JOINING or self._last is None or newest > self._last:
            self.placing = Placing.PLACED


_ALL = slice(None)
_NO_ROWS = PlacedRows(np.zeros(0, np.int64), np.zeros(0, np.int64), 0)


def _nearest(reference: int, low_bits: int, modulus: int) -> int:
    """Return the integer nearest to ``reference`` that equals ``low_bits`` modulo ``modulus``."""
    half = modulus // 2
    return reference + (low_bits - reference + half) % modulus - half


DATA_SIZE = 19
CRC_SIZE = 4
MAX_CHUNK = 85
"""A body of 80 bytes with its CRC and one byte of stuffing."""
READING_BITS, SPIKE_BITS = 10, 3
REMEMBERED_REPORTS = 16
"""A report that equals one of so many before it is a repeat: it names its scan and its number."""


class FingerBlock(NamedTuple):
    """Samples in a row: the board's counter int64 (n,), ascending, flags uint8 (n,), readings
    uint16 (n, 9) and spikes uint8 (n, 9). ``missing`` samples did not arrive before the first or
    between them.
    """

    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    readings: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    missing: int


class FingerDecoder:
    """Decodes the board's byte stream; damaged bytes cost the frames that they touch.

    Repeated and late frames are refused, so that counters ascend until a reboot. ``damaged``
    counts chunks that are no frame, ``reboots`` reboots. While ``connecting``, an identity is an
    answer; later it comes from a board that has just booted.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self.reboots = 0
        self.connecting = True
        self._tail = b""
        self._counter = SampleCounter()
        self._reports: deque[bytes] = deque(maxlen=REMEMBERED_REPORTS)
        self._stale_reports = 0

    @property
    def waiting(self) -> bool:
        """True while samples are dropped until a status tells the whole counter."""
        return self._counter.placing is not Placing.PLACED

    @property
    def stale(self) -> int:
        """Intact frames that repeat others or come behind newer ones."""
        return self._counter.stale + self._stale_reports

    def resync(self) -> None:
        """Join a stream anew: wait for a status, then count the samples in between as missing."""
        self._tail = b""
        self.connecting = True
        self._reports.clear()
        self._counter.join()

    def feed(self, data: bytes) -> tuple[FingerBlock, list[Message]]:
        """Return the samples and the other messages, each in the order of the wire.

        Of a slice with a reboot, the samples after it.
        """
        *chunks, self._tail = (self._tail + data).split(b"\0")
        if len(self._tail) > MAX_CHUNK:
            self._tail = self._tail[: MAX_CHUNK + 1]  # too long for a frame, and stays so
        bodies = [body for chunk in chunks if chunk and (body := self._body(chunk))]
        runs: list[tuple[NDArray[np.uint8], PlacedRows]] = []
        received: list[Message] = []
        for is_data, group in groupby(bodies, _is_data):
            if is_data:
                rows = np.frombuffer(b"".join(group), np.uint8).reshape(-1, DATA_SIZE)
                low = rows[:, 1].astype(np.int64) | rows[:, 2].astype(np.int64) << 8
                runs.append((rows, self._counter.place(low)))
            elif self._take_messages(group, received):
                runs.clear()
        return _block(runs), received

    def _take_messages(self, bodies: Iterable[bytes], received: list[Message]) -> bool:
        """Append the messages in frames that hold no sample; return whether the board rebooted."""
        reboots = self.reboots
        for body in bodies:
            if body[0] in REPORT_TYPES:
                if body in self._reports:
                    self._stale_reports += 1
                    continue
                self._reports.append(body)
            message = decode_message(body)
            if message is None:
                continue
            received.append(message)
            if self._tells_reboot(message):
                self.reboots += 1
                self._reports.clear()
        return self.reboots > reboots

    def _tells_reboot(self, message: Message) -> bool:
        if isinstance(message, FingerStatus):
            return self._counter.tell(message.samples, self.connecting)
        is_boot = isinstance(message, FingerIdentity) and not self.connecting
        return is_boot and self._counter.begin()

    def _body(self, chunk: bytes) -> bytes | None:
        body = _cobs_decode(chunk) if len(chunk) <= MAX_CHUNK else b""
        content, crc = body[:-CRC_SIZE], body[-CRC_SIZE:]
        if content and zlib.crc32(content) == int.from_bytes(crc, "little"):
            return content
        self.damaged += 1
        return None


def _is_data(body: bytes) -> bool:
    return body[0] == DATA_TYPE and len(body) == DATA_SIZE


def _block(runs: list[tuple[NDArray[np.uint8], PlacedRows]]) -> FingerBlock:
    """Return the samples of runs of data frames, uint8 (n, 19) each, as one block."""
    if len(runs) == 1:
        run, placed = runs[0]
        rows, counters, missing = run[placed.rows], placed.counters, placed.missing
    else:
        none = np.zeros((0, DATA_SIZE), np.uint8)
        rows = np.concatenate([none, *(run[placed.rows] for run, placed in runs)])
        counters = np.concatenate([np.zeros(0, np.int64), *(placed.counters for _, placed in runs)])
        missing = sum(placed.missing for _, placed in runs)
    bits = np.unpackbits(rows[:, 4:], axis=1, bitorder="little")
    at = N_TAXELS * READING_BITS
    readings = _numbers(bits[:, :at], READING_BITS).astype(np.uint16)
    spikes = _numbers(bits[:, at : at + N_TAXELS * SPIKE_BITS], SPIKE_BITS).astype(np.uint8)
    return FingerBlock(counters, rows[:, 3].copy(), readings, spikes, missing)


def _numbers(bits: NDArray[np.uint8], width: int) -> NDArray[np.int64]:
    """Return numbers of ``width`` bits, lowest bit first, one row for each row of bits."""
    weights = 1 << np.arange(width)
    per_row = bits.shape[1] // width
    numbers: NDArray[np.int64] = bits.reshape(len(bits), per_row, width) @ weights
    return numbers


def _cobs_decode(chunk: bytes) -> bytes:
    """Return the bytes of a stuffed chunk, empty where it is malformed."""
    out, at = bytearray(), 0
    while at < len(chunk):
        run = chunk[at]
        piece = chunk[at + 1 : at + run]
        if len(piece) != run - 1:
            return b""
        out += piece
        at += run
        if at < len(chunk):
            out.append(0)
    return bytes(out)
