"""Decode the finger board's byte stream, in slices of any length."""

from __future__ import annotations

import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.wire.finger.messages import DATA_TYPE, N_TAXELS, Message, decode_message

DATA_SIZE = 19
CRC_SIZE = 4
MAX_CHUNK = 85
"""A body of 80 bytes with its CRC and one byte of stuffing."""
READING_BITS, SPIKE_BITS = 10, 3


class FingerBlock(NamedTuple):
    """Samples in a row: the board's counter int64 (n,), flags uint8 (n,), readings uint16 (n, 9)
    and spikes uint8 (n, 9). ``missing`` samples did not arrive before the first or between them.
    """

    counters: NDArray[np.int64]
    flags: NDArray[np.uint8]
    readings: NDArray[np.uint16]
    spikes: NDArray[np.uint8]
    missing: int


class FingerDecoder:
    """Decodes the board's byte stream; damaged bytes cost the frames that they touch."""

    def __init__(self) -> None:
        self._tail = b""
        self._last_counter = -1
        self.damaged = 0

    def feed(self, data: bytes) -> tuple[FingerBlock, list[Message]]:
        """Return the samples and the other messages, each in the order of the wire."""
        *chunks, self._tail = (self._tail + data).split(b"\0")
        if len(self._tail) > MAX_CHUNK:
            self._tail = self._tail[: MAX_CHUNK + 1]  # too long for a frame, and stays so
        bodies = [body for chunk in chunks if chunk and (body := self._body(chunk))]
        samples = [body for body in bodies if body[0] == DATA_TYPE and len(body) == DATA_SIZE]
        messages = [decode_message(body) for body in bodies if body[0] != DATA_TYPE]
        return self._block(samples), [message for message in messages if message is not None]

    def _body(self, chunk: bytes) -> bytes | None:
        body = _cobs_decode(chunk) if len(chunk) <= MAX_CHUNK else b""
        content, crc = body[:-CRC_SIZE], body[-CRC_SIZE:]
        if content and zlib.crc32(content) == int.from_bytes(crc, "little"):
            return content
        self.damaged += 1
        return None

    def _block(self, bodies: list[bytes]) -> FingerBlock:
        rows = np.frombuffer(b"".join(bodies), np.uint8).reshape(-1, DATA_SIZE)
        counters, missing = self._unwrap(rows[:, 1].astype(np.int64) | rows[:, 2].astype(int) << 8)
        bits = np.unpackbits(rows[:, 4:], axis=1, bitorder="little")
        at = N_TAXELS * READING_BITS
        readings = _numbers(bits[:, :at], READING_BITS).astype(np.uint16)
        spikes = _numbers(bits[:, at : at + N_TAXELS * SPIKE_BITS], SPIKE_BITS).astype(np.uint8)
        return FingerBlock(counters, rows[:, 3].copy(), readings, spikes, missing)

    def _unwrap(self, low: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
        """Return whole counters from their low 16 bits, and how many samples are missing."""
        if not len(low):
            return low, 0
        first = self._last_counter if self._last_counter >= 0 else int(low[0]) - 1
        steps = np.diff(low, prepend=first & 0xFFFF) & 0xFFFF
        counters = first + np.cumsum(steps)
        self._last_counter = int(counters[-1])
        return counters, int(np.sum(np.maximum(steps - 1, 0)))


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
