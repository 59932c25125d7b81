"""An asyncio transport over any byte link, so that pymodbus runs over ports and simulations."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Protocol

from pymodbus.exceptions import ModbusException

from rigctl.devices.links.byte_link import ByteLink, OnLost
from rigctl.errors import LinkLost


class Receiver(Protocol):
    """The side of an asyncio protocol that a transport calls."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The link is open."""
        ...

    def data_received(self, data: bytes) -> None:
        """Bytes arrived."""
        ...


class LinkTransport(asyncio.Transport):
    """Carries one protocol's bytes over one link; opening and losing go through the link."""

    def __init__(self, link: ByteLink, protocol: Receiver, on_lost: OnLost) -> None:
        super().__init__()
        self._link = link
        self._protocol = protocol
        self._on_lost = on_lost
        self._closing = False
        self.bytes_received = 0
        self.received_at_s = 0.0

    def open(self) -> None:
        """Open the link and tell the protocol. Raises LinkLost."""
        self._link.open(self._received, self._lost)
        self._protocol.connection_made(self)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send; a link lost meanwhile is reported through ``on_lost``, not raised here."""
        try:
            self._link.write(bytes(data))
        except LinkLost as lost:
            self._lost(str(lost))

    def close(self) -> None:
        """Close the link; the protocol is not told, it asked."""
        self._closing = True
        self._link.close()

    def is_closing(self) -> bool:
        """True once closed or lost."""
        return self._closing

    def _received(self, data: bytes, at_s: float) -> None:
        self.bytes_received += len(data)
        self.received_at_s = at_s
        # A damaged reply that is no Modbus answer is dropped: the exchange times out.
        with suppress(ModbusException):
            self._protocol.data_received(data)

    def _lost(self, reason: str) -> None:
        if not self._closing:
            self._closing = True
            self._link.close()
            self._on_lost(reason)
