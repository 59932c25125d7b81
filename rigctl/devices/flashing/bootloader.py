"""What a board's bootloader says of its chip; avrdude would take a minute to give up.

The wire is STK500 (Atmel AVR061) for Uno and Nano, STK500 v2 (AVR068) for a Mega.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import reduce
from operator import xor

from rigctl.devices.links.serial import SerialLink

ANSWER_S = 0.15
"""A bootloader answers within some milliseconds, USB included."""
CLOSED_S = 0.1
"""The board sees that the port was closed before the next program opens it."""
ATTEMPTS = 6
"""An Uno's bootloader blinks for a third of a second before it listens."""

_IN_SYNC, _OK, _END = b"\x14", b"\x10", b" "
_GET_SYNC, _READ_SIGNATURE = b"0" + _END, b"u" + _END
_MESSAGE_START, _TOKEN = 0x1B, 0x0E
_SIGN_ON, _SPI_MULTI, _READ_SIGNATURE_BYTE = 0x01, 0x1D, 0x30


@dataclass(frozen=True, slots=True)
class BootloaderKind:
    """A kind of bootloader: how it is called, and ``programmer`` and ``baud`` for avrdude."""

    name: str
    programmer: str
    baud: int


MEGA = BootloaderKind("Mega bootloader", "wiring", 115_200)
OPTIBOOT = BootloaderKind("Optiboot", "arduino", 115_200)
OLD_NANO = BootloaderKind("old Nano bootloader", "arduino", 57_600)


async def ask_signature(
    port: str, kind: BootloaderKind, loop: asyncio.AbstractEventLoop
) -> bytes | None:
    """Reset the board and return the three bytes of its chip's signature.

    None where no bootloader of this ``kind`` answers. Raises LinkLost where the port cannot be
    opened or vanishes.
    """
    link = SerialLink(port, kind.baud, loop)
    line = _Line(link)
    try:
        await link.reset_board()
        return await (_ask_v2(line) if kind is MEGA else _ask_v1(line))
    finally:
        link.close()
        await asyncio.sleep(CLOSED_S)


class _Line:
    """Requests over one open link, each with the bytes that answer it in time."""

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._received = b""
        self._changed = asyncio.Event()
        link.open(self._take, lambda reason: self._changed.set())

    async def ask(self, request: bytes, count: int) -> bytes:
        """Return the first ``count`` bytes of the answer, fewer where they do not come."""
        self._received = b""
        self._link.write(request)
        try:
            async with asyncio.timeout(ANSWER_S):
                while len(self._received) < count:
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            pass
        return self._received[:count]

    def _take(self, data: bytes, at_s: float) -> None:
        self._received += data
        self._changed.set()


async def _ask_v1(line: _Line) -> bytes | None:
    for _ in range(ATTEMPTS):
        if await line.ask(_GET_SYNC, 2) == _IN_SYNC + _OK:
            answer = await line.ask(_READ_SIGNATURE, 5)
            if len(answer) == 5 and answer[:1] + answer[-1:] == _IN_SYNC + _OK:
                return answer[1:4]
    return None


async def _ask_v2(line: _Line) -> bytes | None:
    for _ in range(ATTEMPTS):
        if _body(await line.ask(_message(_SIGN_ON), 17))[:2] != bytes([_SIGN_ON, 0]):
            continue
        signature = b""
        for index in range(3):
            request = _message(_SPI_MULTI, 4, 4, 0, _READ_SIGNATURE_BYTE, 0, index, 0)
            signature += _body(await line.ask(request, 13))[5:6]
        return signature if len(signature) == 3 else None
    return None


def _message(*body: int) -> bytes:
    head = bytes([_MESSAGE_START, 1, 0, len(body), _TOKEN, *body])
    return head + bytes([reduce(xor, head)])


def _body(message: bytes) -> bytes:
    """Return the body of a message, empty where it is damaged or not whole."""
    if len(message) < 7 or message[0] != _MESSAGE_START or reduce(xor, message):
        return b""
    return message[5:-1]
