"""A Modbus RTU client over a byte link: one exchange at a time, and a stop that preempts it.

pymodbus encodes requests and decodes replies (decision 0019); frames, timeouts and retries are
here. A request whose reply is lost is sent again while the link counts as alive: every request of
the drum may safely be executed twice, because a command executes only when its sequence is new.

Most replies do not say which request they answer. One counts only where no reply to an earlier
request can still be on the line, and where it is no repeat of the reply before.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pymodbus.pdu import ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteMultipleRegistersResponse,
)

from rigctl.boards.boot_silence import BootSilence
from rigctl.boards.drum_registers import UNIT
from rigctl.boards.links import ByteLink
from rigctl.errors import CommandRefused, LinkLost

MAX_FRAME_BYTES = 256
_READ, _WRITE, _READ_WRITE = 3, 16, 23
_HEAD_BYTES, _EXCEPTION_BYTES, _WRITE_REPLY_BYTES = 4, 5, 8


class CorruptFrame(ValueError):
    """A reply has its full length, but its CRC or its head is wrong."""


def _crc_table() -> NDArray[np.uint16]:
    """Return the CRC of each single byte for the polynomial of Modbus, low bit first."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 1, table >> 1 ^ 0xA001, table >> 1)
    return table.astype(np.uint16)


_CRC_TABLE = _crc_table()


@njit(cache=True, nogil=True)
def crc(data: bytes) -> int:
    """Return CRC-16 of Modbus over serial line (V1.02, §6.2.2); 0 over a frame with its CRC."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _CRC_TABLE[(value ^ byte) & 0xFF]
    return value


def compile_crc() -> None:
    """Compile :func:`crc` or load it from the cache; later it would delay a heartbeat."""
    crc(b"")


def encode_frame(unit: int, pdu: bytes) -> bytes:
    """Return the frame of a request: unit, PDU, CRC low byte first."""
    body = bytes([unit]) + pdu
    return body + crc(body).to_bytes(2, "little")


def find_reply(data: bytes, unit: int) -> bytes | None:
    """Return the PDU of the first intact reply of ``unit``, also behind other bytes.

    Returns None while the reply is incomplete. Raises CorruptFrame if no reply in ``data`` is
    intact although the first has its full length.
    """
    first_end = 0
    start = data.find(unit)
    while start >= 0:
        length = _reply_length(data, start)
        end = start + length
        if length and end <= len(data) and crc(data[start:end]) == 0:
            return data[start + 1 : end - 2]
        first_end = first_end or (end if length else 0)
        start = data.find(unit, start + 1)
    if first_end and first_end <= len(data):
        raise CorruptFrame(f"no intact reply in {len(data)} bytes")
    return None


def _reply_length(data: bytes, start: int) -> int:
    """Return the length of the reply that begins at ``start``, 0 where no reply begins there."""
    if start + _HEAD_BYTES > len(data):
        return _HEAD_BYTES
    function = data[start + 1]
    if function & 0x80:
        return _EXCEPTION_BYTES
    if function == _WRITE:
        return _WRITE_REPLY_BYTES
    return 5 + data[start + 2] if function in (_READ, _READ_WRITE) else 0


REPLY_TIMEOUT_S = 0.06
MIN_REPLY_TIMEOUT_S = 0.02
"""Shortest wait before a retry: the board drops half a request after 10 ms of silence."""
LINK_TIMEOUT_S = 0.24
"""A link without a reply for this time, in spite of retries, counts as lost."""
DRAIN_S = 0.012
"""After this pause no reply to an abandoned request is on the line."""
LATE_REPLY_S = 0.1
"""A reply to a request that was sent again, or abandoned, may come within this time."""
CLOCK_STEP_S = 1e-6
"""Loop times that differ by less are the same."""
REFUSAL = -1
AVERAGED_REPLIES = 8
"""Number of replies over which the usual reply time adapts."""

_RESPONSES: dict[int, type[ModbusPDU]] = {
    3: ReadHoldingRegistersResponse,
    16: WriteMultipleRegistersResponse,
    23: ReadWriteMultipleRegistersResponse,
}
_EXCEPTION_REASONS = {
    1: "because it does not know the function",
    2: "because there is no such register",
    3: "because a value is out of range",
    4: "because its state does not allow it",
    6: "because it is busy",
}


class RequestRefused(CommandRefused):
    """The board replied with a Modbus exception; ``code`` is its number."""

    def __init__(self, name: str, code: int) -> None:
        reason = _EXCEPTION_REASONS.get(code, "for an unknown reason")
        super().__init__(f"{name}: the board refused, {reason}")
        self.code = code


class PreemptedByStop(CommandRefused):
    """A stop preempted this request."""


class AdaptiveTimeout:
    """Twice the usual reply time, between ``MIN_REPLY_TIMEOUT_S`` and ``REPLY_TIMEOUT_S``.

    A missing reply raises it, so that a line that became slower has time to answer.
    """

    def __init__(self) -> None:
        self._usual_s = REPLY_TIMEOUT_S

    @property
    def timeout_s(self) -> float:
        """Longest wait for the next reply."""
        return min(REPLY_TIMEOUT_S, max(MIN_REPLY_TIMEOUT_S, 2.0 * self._usual_s))

    def record_reply(self, duration_s: float) -> None:
        """Count a reply to a request that was sent once."""
        change_s = (duration_s - self._usual_s) / AVERAGED_REPLIES
        self._usual_s = max(duration_s, self._usual_s + change_s)

    def record_timeout(self) -> None:
        """Count a request without a reply."""
        self._usual_s = min(REPLY_TIMEOUT_S, self._usual_s + self.timeout_s / 16)


@dataclass(frozen=True, slots=True)
class _Request:
    """A request, and how many registers its reply holds. ``is_urgent``: it is a stop."""

    pdu: ModbusPDU
    count: int = 0
    retry_early: bool = False
    is_urgent: bool = False

    @property
    def frame(self) -> bytes:
        function = self.pdu.function_code.to_bytes()
        return encode_frame(UNIT, function + self.pdu.encode())

    def is_answered_by(self, reply: ModbusPDU) -> bool:
        """Return whether function and length of ``reply`` are those of a reply to this."""
        same_function = reply.function_code & 0x7F == self.pdu.function_code
        return same_function and (reply.isError() or len(reply.registers) == self.count)


class ModbusClient:
    """Registers of one board over one link.

    ``timeouts`` counts replies that are missing or damaged, ``stale`` replies to other requests,
    ``retries`` polls that were sent again.
    ``bytes_received`` counts all bytes since the link was opened, ``received_at_s`` is the loop
    time of the newest. While ``silence`` is on, only a stop is sent.
    """

    def __init__(self, link: ByteLink, loop: asyncio.AbstractEventLoop) -> None:
        self.link = link
        self.silence = BootSilence(link, loop)
        self.timeouts = 0
        self.stale = 0
        self.retries = 0
        self.bytes_received = 0
        self.received_at_s = 0.0
        self._loop = loop
        self._adaptive_timeout = AdaptiveTimeout()
        self._not_open = f"{link.name}: not connected: connect first"
        self._closed_reason: str | None = self._not_open
        self._buffer = b""
        self._reply: asyncio.Future[bytes] | None = None
        self._last_reply = b""
        self._sent: _Request | None = None
        self._quiet_s: dict[tuple[int, int], float] = {}
        """By function and registers, REFUSAL for none: the loop time from which such a reply is
        none to an earlier request."""
        self._lock = asyncio.Lock()
        self._stops_pending = self._stops_total = 0
        self._no_stop_pending = asyncio.Event()
        self._no_stop_pending.set()
        compile_crc()

    def open(self) -> None:
        """Open the link unless it is open. Raises LinkLost.

        A link that only fell silent stays open: opening a serial port resets most Arduinos, and
        a drum that is just lifting must not be reset.
        """
        if self._closed_reason is None and self.link.is_open:
            return
        self.bytes_received = 0
        self.silence.open_link(self._on_bytes, self._on_lost)
        self._closed_reason = None

    def close(self) -> None:
        """Close the link; an exchange in flight ends with LinkLost."""
        self._abort(LinkLost(f"{self.link.name}: the port was closed"))
        self.link.close()
        self._closed_reason = self._not_open

    async def read(self, address: int, count: int) -> list[int]:
        """Read ``count`` registers from ``address``."""
        pdu = ReadHoldingRegistersRequest(address=address, count=count)
        return await self._registers(_Request(pdu, count))

    async def write(
        self, address: int, words: Sequence[int], resume_after_stop: bool = True
    ) -> None:
        """Write registers; raises PreemptedByStop unless the write may resume after a stop."""
        await self._execute(_write_request(address, words), resume_after_stop)

    async def read_write(
        self,
        read_address: int,
        count: int,
        address: int,
        words: Sequence[int],
        retry_early: bool = False,
    ) -> list[int]:
        """Write registers, then read ``count`` of them, in one exchange.

        ``retry_early`` repeats the request as soon as its reply is later than usual. This is
        only for requests whose reply shows which request it answers.
        """
        pdu = ReadWriteMultipleRegistersRequest(read_address, count, address, words)
        return await self._registers(_Request(pdu, count, retry_early))

    async def urgent_write(self, address: int, words: Sequence[int]) -> None:
        """Write immediately: abandon the reply in flight, let queued requests wait.

        The reply to another urgent write is not abandoned: several stops at once are all answered.
        """
        self._stops_pending += 1
        self._stops_total += 1
        self._no_stop_pending.clear()
        if self._sent is None or not self._sent.is_urgent:
            self._abort(self._preempted())
        try:
            async with self._lock:
                await self._retry_until_answered(_write_request(address, words, is_urgent=True))
        except LinkLost:
            if self.silence.is_on:  # a bootloader that got the stop listens again
                self.silence.lose()
            raise
        finally:
            self._stops_pending -= 1
            if not self._stops_pending:
                self._no_stop_pending.set()

    async def _registers(self, request: _Request) -> list[int]:
        return list((await self._execute(request)).registers)

    async def _execute(self, request: _Request, resume_after_stop: bool = True) -> ModbusPDU:
        """Run one exchange when the line is free and no stop is pending."""
        stops_before = self._stops_total
        while True:
            if self._stops_pending:
                await self._no_stop_pending.wait()
            if self.silence.is_on:
                raise LinkLost(self.silence.text)
            if (wait_s := self._quiet_from_s(request, request.count) - self._loop.time()) > 0.0:
                await asyncio.sleep(wait_s)
            async with self._lock:
                if not resume_after_stop and self._stops_total != stops_before:
                    raise self._preempted()
                if not self._stops_pending:
                    with suppress(PreemptedByStop):
                        return await self._retry_until_answered(request)

    async def _retry_until_answered(self, request: _Request) -> ModbusPDU:
        """Repeat a request until its reply comes; raises LinkLost after ``LINK_TIMEOUT_S``."""
        sent_s = self._loop.time()
        deadline_s = sent_s + LINK_TIMEOUT_S - REPLY_TIMEOUT_S / 2
        repeated = False
        while True:
            asked_s = self._loop.time()
            reply = await self._exchange(request)
            if reply is not None and self._answers(request, reply, asked_s):
                if repeated:
                    self._expect_late_reply()
                self.silence.hear(self._loop.time())
                if isinstance(reply, ExceptionResponse):
                    raise RequestRefused(self.link.name, reply.exception_code)
                if request.retry_early and not repeated:
                    self._adaptive_timeout.record_reply(self._loop.time() - sent_s)
                return reply
            if reply is not None:
                self.stale += 1
                self._last_reply = b""
                await asyncio.sleep(DRAIN_S)
            if self._stops_pending and not request.is_urgent:
                raise self._preempted()
            if self._loop.time() >= deadline_s:
                self._expect_late_reply()
                raise LinkLost(
                    f"{self.link.name}: no answer for {LINK_TIMEOUT_S:g} s: "
                    "check the cable and the board's supply, then connect again"
                )
            repeated = True
            self.retries += request.retry_early

    async def _exchange(self, request: _Request) -> ModbusPDU | None:
        """Send a request and return its reply, None where it is missing or damaged.

        What may be the reply before once more answers no request.
        """
        if self._closed_reason is not None:
            raise LinkLost(self._closed_reason)
        early = request.retry_early
        timeout_s = self._adaptive_timeout.timeout_s if early else REPLY_TIMEOUT_S
        self._buffer = b""
        self._reply, self._sent = self._loop.create_future(), request
        timer = self._loop.call_later(timeout_s, _time_out, self._reply)
        try:
            self._send(request.frame)
            pdu = await self._reply
            repeats, self._last_reply = pdu == self._last_reply, pdu
            return ModbusPDU() if repeats and not early else _decode(pdu)
        except CorruptFrame:
            pass
        except TimeoutError:
            if early:
                self._adaptive_timeout.record_timeout()
        finally:
            timer.cancel()
        self.timeouts += 1
        return None

    def _send(self, frame: bytes) -> None:
        try:
            self.link.write(frame)
        except LinkLost as lost:
            self._on_lost(str(lost))

    def _on_bytes(self, data: bytes, at_s: float) -> None:
        self.bytes_received += len(data)
        self.received_at_s = at_s
        if self._reply is None or self._reply.done():
            return
        self._buffer += data
        try:
            pdu = find_reply(self._buffer, UNIT)
        except CorruptFrame as corrupt:
            self._reply.set_exception(corrupt)
            return
        if pdu is not None:
            self._reply.set_result(pdu)
        elif len(self._buffer) >= MAX_FRAME_BYTES:
            self._buffer = b""

    def _on_lost(self, reason: str) -> None:
        if self._closed_reason is None:
            self._closed_reason = reason
            self.link.close()
            self.silence.end()
            self._abort(LinkLost(reason))

    def _abort(self, error: Exception) -> None:
        """End the wait for the reply in flight, if there is one."""
        if self._reply is not None and not self._reply.done():
            self._expect_late_reply()
            self._reply.set_exception(error)

    def _answers(self, request: _Request, reply: ModbusPDU, asked_s: float) -> bool:
        """Return whether ``reply`` is that to ``request``, sent at ``asked_s``, and to no other."""
        count = REFUSAL if reply.isError() else request.count
        certain = asked_s > self._quiet_from_s(request, count) - CLOCK_STEP_S
        return certain and request.is_answered_by(reply)

    def _quiet_from_s(self, request: _Request, count: int) -> float:
        if request.retry_early:
            return float("-inf")
        return self._quiet_s.get((request.pdu.function_code, count), float("-inf"))

    def _expect_late_reply(self) -> None:
        """Note that the request sent last is done, but may be answered later or once more."""
        sent = self._sent
        if sent is not None and not sent.retry_early:
            for count in (sent.count, REFUSAL):
                self._quiet_s[sent.pdu.function_code, count] = self._loop.time() + LATE_REPLY_S

    def _preempted(self) -> PreemptedByStop:
        return PreemptedByStop(f"{self.link.name}: a stop preempted this request")


def _time_out(reply: asyncio.Future[bytes]) -> None:
    if not reply.done():
        reply.set_exception(TimeoutError())


def _decode(pdu: bytes) -> ModbusPDU:
    is_exception = pdu[0] & 0x80
    reply = ExceptionResponse(pdu[0]) if is_exception else _RESPONSES[pdu[0]]()
    reply.decode(pdu[1:])
    return reply


def _write_request(address: int, words: Sequence[int], is_urgent: bool = False) -> _Request:
    pdu = WriteMultipleRegistersRequest(address=address, registers=list(words))
    return _Request(pdu, is_urgent=is_urgent)
