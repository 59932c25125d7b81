"""The slave's side of Modbus RTU: bytes in, answers out; functions 3, 6, 16 and 23.

A frame ends by its function's length. Ten milliseconds of silence start anew; after a frame
that makes no sense the rest is dropped up to that silence.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Protocol

from rigctl.wire.drum_map import UNIT
from rigctl.wire.modbus_frame import READ, READ_WRITE, WRITE, WRITE_ONE, crc, framed, warm

RESET_SILENCE_US = 10_000
LONGEST_REQUEST = 64
MOST_WORDS = 125


class Answer(IntEnum):
    """Exception codes of the standard; OK is none."""

    OK = 0
    UNKNOWN_FUNCTION = 1
    NO_REGISTER = 2
    BAD_VALUE = 3
    REFUSED = 4


class Bank(Protocol):
    """The registers behind the slave."""

    def exists(self, address: int, count: int) -> bool:
        """All these addresses can be read."""
        ...

    def read(self, address: int, count: int) -> Sequence[int]:
        """Words of addresses that exist."""
        ...

    def write(self, address: int, words: Sequence[int]) -> Answer:
        """Apply all words or, for any answer but OK, none."""
        ...


class ModbusSlave:
    """Takes the bytes of the line and gives the bytes to answer with."""

    def __init__(self, bank: Bank) -> None:
        self._bank = bank
        self._pending = bytearray()
        self._lost = False
        self._last_us = -RESET_SILENCE_US
        self.frames_seen = 0
        self.exceptions_sent = 0
        self.crc_errors = 0
        warm()

    def take(self, data: bytes, first_us: int, last_us: int) -> bytes:
        """Answers to the requests that ``data`` completes, which came between these times."""
        if first_us - self._last_us >= RESET_SILENCE_US:
            self._start_anew()
        self._last_us = last_us
        answers = b""
        if self._lost:
            return answers
        self._pending += data
        while (length := self._frame_length()) and length <= len(self._pending):
            request = bytes(self._pending[:length])
            del self._pending[:length]
            if crc(request) != 0:
                self._lose()
                break
            answers += self._serve(request)
        return answers

    def _start_anew(self) -> None:
        if self._pending and not self._lost:
            self.crc_errors += 1
        self._pending.clear()
        self._lost = False

    def _lose(self) -> None:
        self.crc_errors += 1
        self._lost = True
        self._pending.clear()

    def _frame_length(self) -> int:
        """Bytes of the frame that begins the buffer; 0 while they cannot be known."""
        pending = self._pending
        function = pending[1] if len(pending) > 1 else 0
        length = 0
        if function in (READ, WRITE_ONE):
            length = 8
        elif function == WRITE and len(pending) > 6:
            length = 9 + pending[6]
        elif function == READ_WRITE and len(pending) > 10:
            length = 13 + pending[10]
        elif function not in (0, WRITE, READ_WRITE):
            length = self._by_crc()
        if length > LONGEST_REQUEST or (not length and len(pending) >= LONGEST_REQUEST):
            self._lose()
            return 0
        return length

    def _by_crc(self) -> int:
        """A function not served here has no length to go by: it ends where its CRC fits."""
        pending = bytes(self._pending)
        return next((n for n in range(4, len(pending) + 1) if crc(pending[:n]) == 0), 0)

    def _serve(self, request: bytes) -> bytes:
        if request[0] != UNIT:
            return b""
        self.frames_seen += 1
        function, body = request[1], request[2:-2]
        if function == READ:
            answer, reply = self._read(*struct.unpack(">HH", body))
        elif function == WRITE_ONE:
            address, word = struct.unpack(">HH", body)
            answer, reply = self._bank.write(address, (word,)), body
        elif function == WRITE:
            answer, reply = self._write(body), body[:4]
        elif function == READ_WRITE:
            answer, reply = self._read_write(body)
        else:
            answer, reply = Answer.UNKNOWN_FUNCTION, b""
        if answer is not Answer.OK:
            self.exceptions_sent += 1
            return framed(bytes([UNIT, function | 0x80, answer]))
        return framed(bytes([UNIT, function]) + reply)

    def _read(self, address: int, count: int) -> tuple[Answer, bytes]:
        if not 1 <= count <= MOST_WORDS:
            return Answer.BAD_VALUE, b""
        if not self._bank.exists(address, count):
            return Answer.NO_REGISTER, b""
        words = self._bank.read(address, count)
        return Answer.OK, bytes([2 * count]) + struct.pack(f">{count}H", *words)

    def _write(self, body: bytes) -> Answer:
        address, count, size = struct.unpack_from(">HHB", body)
        if count == 0 or size != 2 * count:
            return Answer.BAD_VALUE
        return self._bank.write(address, struct.unpack_from(f">{count}H", body, 5))

    def _read_write(self, body: bytes) -> tuple[Answer, bytes]:
        address, count = struct.unpack_from(">HH", body)
        if not 1 <= count <= MOST_WORDS:
            return Answer.BAD_VALUE, b""
        if not self._bank.exists(address, count):
            return Answer.NO_REGISTER, b""
        answer = self._write(body[4:])
        return (answer, b"") if answer is not Answer.OK else self._read(address, count)
