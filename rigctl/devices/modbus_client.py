"""Modbus RTU to one board: one exchange at a time, and a stop that waits for none.

pymodbus builds and reads the frames. This file decides what may be repeated: an exchange whose
reply was lost is repeated while the link counts as alive, because every request of the drum's
wire may safely be executed twice (a command executes only when its sequence number is new).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusIOException
from pymodbus.pdu import ModbusPDU

from rigctl.devices.links.asyncio_transport import LinkTransport
from rigctl.devices.links.byte_link import ByteLink
from rigctl.devices.modbus_framer import ReplyFramer
from rigctl.devices.reply_timeout import ReplyTimeout
from rigctl.errors import CommandRefused, LinkLost
from rigctl.wire import modbus_rtu
from rigctl.wire.drum.register_table import UNIT
from rigctl.wire.modbus_rtu import READ, READ_WRITE, WRITE

REPLY_S = 0.06
"""Longest wait for one reply."""
LEAST_REPLY_S = 0.02
"""A poll is not asked again sooner: the board forgets half a request after 10 ms of silence."""
SILENCE_S = 0.24
"""Silence in spite of questions after which the link counts as lost."""
DRAIN_S = 0.012
"""A pause after which no reply to an abandoned request is on the line any more."""

# Lost replies are counted and reported by this file; pymodbus would print them as well.
logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)

_Request = Callable[[AsyncModbusSerialClient], Awaitable[ModbusPDU]]


@dataclass(frozen=True, slots=True)
class _Question:
    """A request, and what marks its reply: the function and how many registers."""

    request: _Request
    function: int
    count: int | None = None
    hurried: bool = False


class Refused(CommandRefused):
    """The board answered with a Modbus exception; ``code`` says which."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class StoppedMeanwhile(CommandRefused):
    """A stop overtook this request, which was given up."""


class _Damaged(ModbusIOException):
    """A reply of the right length, but not as it was sent."""


class ModbusClient:
    """Registers of one board over one link.

    ``timeouts`` counts replies that did not come or not whole, ``damaged`` those of them that
    came damaged, ``stale`` replies to another question, ``retries`` polls that were asked again.
    """

    def __init__(self, link: ByteLink, loop: asyncio.AbstractEventLoop) -> None:
        self.link = link
        self.timeouts = 0
        self.damaged = 0
        self.stale = 0
        self.retries = 0
        self._patience = ReplyTimeout(LEAST_REPLY_S, REPLY_S)
        self._loop = loop
        self._client: AsyncModbusSerialClient | None = None
        self._transport: LinkTransport | None = None
        self._lost: str | None = None
        self._lock = asyncio.Lock()
        self._stops = self._stops_ever = 0
        modbus_rtu.warm()
        self._calm = asyncio.Event()
        self._calm.set()

    @property
    def bytes_received(self) -> int:
        """Bytes that came since the line was opened, whatever they mean."""
        return self._transport.bytes_received if self._transport else 0

    @property
    def received_at_s(self) -> float:
        """Loop time of the newest bytes."""
        return self._transport.received_at_s if self._transport else 0.0

    async def open(self) -> None:
        """Open the link, unless it is open and only fell silent. Raises LinkLost.

        Opening a serial port resets most Arduinos, and a drum that is just lifting off must
        not be reset.
        """
        if self._client is not None and self._lost is None and self.link.is_open:
            return
        self.close()
        client = AsyncModbusSerialClient(
            self.link.name, timeout=REPLY_S, retries=0, reconnect_delay=0
        )
        transport = LinkTransport(self.link, client.ctx, self._on_lost)

        async def create() -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
            transport.open()
            return transport, client.ctx

        client.ctx.call_create = create
        client.ctx.framer = ReplyFramer(self._on_damaged)
        self._client, self._transport, self._lost = client, transport, None
        try:
            await client.connect()
        except LinkLost:
            self._client = self._transport = None
            raise

    def close(self) -> None:
        """Close the link; an exchange in flight ends with LinkLost."""
        if self._client is not None:
            self._give_up(LinkLost(f"{self.link.name}: the port was closed"))
            self._client.close()
        self._client = self._transport = None

    async def read(self, address: int, count: int) -> list[int]:
        """``count`` registers from ``address``."""
        request = partial(_read, address, count)
        return await self._words(_Question(request, READ, count))

    async def write(self, address: int, words: Sequence[int], once: bool = False) -> None:
        """Write registers; with ``once`` a stop that overtakes raises StoppedMeanwhile."""
        await self._ask(_Question(partial(_write, address, words), WRITE), once)

    async def read_write(
        self,
        read_address: int,
        count: int,
        address: int,
        words: Sequence[int],
        hurried: bool = False,
    ) -> list[int]:
        """Write registers, then read ``count`` of them, in one exchange.

        ``hurried``: ask again as soon as a reply is later than usual. Only for a question whose
        answer shows by itself which question it answers.
        """
        request = partial(_read_write, read_address, count, address, words)
        return await self._words(_Question(request, READ_WRITE, count, hurried))

    async def urgent_write(self, address: int, words: Sequence[int]) -> None:
        """Write at once: the reply in flight is abandoned, waiting requests wait on."""
        self._stops += 1
        self._stops_ever += 1
        self._calm.clear()
        self._give_up(self._overtaken())
        try:
            async with self._lock:
                question = _Question(partial(_write, address, words), WRITE)
                await self._until_answered(question, urgent=True)
        finally:
            self._stops -= 1
            if not self._stops:
                self._calm.set()

    async def _words(self, question: _Question) -> list[int]:
        return list((await self._ask(question)).registers)

    async def _ask(self, question: _Question, once: bool = False) -> ModbusPDU:
        """One exchange when it is its turn; with ``once`` never after a stop asked for since."""
        stops_then = self._stops_ever
        while True:
            await self._calm.wait()
            async with self._lock:
                if once and self._stops_ever != stops_then:
                    raise self._overtaken()
                if not self._stops:
                    with suppress(StoppedMeanwhile):
                        return await self._until_answered(question)

    async def _until_answered(self, question: _Question, urgent: bool = False) -> ModbusPDU:
        """Repeat a request until the right reply comes or the silence lasts too long."""
        asked_s = self._loop.time()
        give_up_s = asked_s + SILENCE_S - REPLY_S / 2
        repeated = False
        while True:
            reply = await self._exchange(question)
            if reply is not None and reply.function_code & 0x7F == question.function:
                if reply.isError():
                    raise self._refused(reply)
                if question.count is None or len(reply.registers) == question.count:
                    if question.hurried and not repeated:
                        self._patience.answered(self._loop.time() - asked_s)
                    return reply
            if reply is not None:
                self.stale += 1
                await asyncio.sleep(DRAIN_S)
            if self._stops and not urgent:
                raise self._overtaken()
            if self._loop.time() >= give_up_s:
                raise self._silent()
            repeated = True
            self.retries += question.hurried

    async def _exchange(self, question: _Question) -> ModbusPDU | None:
        """One request and its reply; None where none came in time, or not whole."""
        if self._client is None or self._lost is not None:
            raise LinkLost(self._lost or f"{self.link.name}: not connected: connect first")
        wait_s = self._patience.wait_s if question.hurried else REPLY_S
        self._client.ctx.comm_params.timeout_connect = wait_s
        try:
            return await question.request(self._client)
        except _Damaged:
            self.damaged += 1
        except ModbusIOException:
            if question.hurried:
                self._patience.missed()
        self.timeouts += 1
        return None

    def _overtaken(self) -> StoppedMeanwhile:
        return StoppedMeanwhile(f"{self.link.name}: a stop came first, nothing else was done")

    def _silent(self) -> LinkLost:
        return LinkLost(
            f"{self.link.name}: no answer for {SILENCE_S:g} s: "
            "check the cable and the board's supply, then connect again"
        )

    def _refused(self, reply: Any) -> Refused:
        words = _EXCEPTIONS.get(reply.exception_code, "for a reason of its own")
        return Refused(f"{self.link.name}: the board refused, {words}", reply.exception_code)

    def _on_damaged(self) -> None:
        """A reply came that is none: ask again at once."""
        self._give_up(_Damaged("the reply is damaged"))

    def _on_lost(self, reason: str) -> None:
        self._lost = reason
        self._give_up(LinkLost(reason))

    def _give_up(self, why: Exception) -> None:
        """End the wait for the reply in flight, if there is one."""
        if self._client is not None and self._lock.locked():
            waiting = self._client.ctx.response_future
            if not waiting.done():
                waiting.set_exception(why)


_EXCEPTIONS = {
    1: "because it does not know the function",
    2: "because there is no such register",
    3: "because a value is out of range",
    4: "because its state does not allow it",
    6: "because it is busy",
}


def _read(address: int, count: int, client: AsyncModbusSerialClient) -> Awaitable[ModbusPDU]:
    return client.read_holding_registers(address, count=count, device_id=UNIT)


def _write(
    address: int, words: Sequence[int], client: AsyncModbusSerialClient
) -> Awaitable[ModbusPDU]:
    return client.write_registers(address, list(words), device_id=UNIT)


def _read_write(
    read_address: int,
    count: int,
    address: int,
    words: Sequence[int],
    client: AsyncModbusSerialClient,
) -> Awaitable[ModbusPDU]:
    return client.readwrite_registers(
        read_address=read_address,
        read_count=count,
        write_address=address,
        values=list(words),
        device_id=UNIT,
    )
