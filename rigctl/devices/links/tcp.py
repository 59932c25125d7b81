"""A byte link over TCP: the boards that ``rigctl serve`` offers."""

from __future__ import annotations

import asyncio
import socket

from rigctl.devices.links.byte_link import OnBytes, OnLost
from rigctl.errors import ConfigError, LinkLost

SCHEME = "tcp://"
CONNECT_TIMEOUT_S = 2.0
READ_SIZE = 65536


class TcpLink:
    """One TCP connection; ``address`` is ``tcp://HOST:PORT``. Needs a selector loop."""

    def __init__(self, address: str, loop: asyncio.AbstractEventLoop) -> None:
        self.name = address
        self.resets_board = False
        self._address = _host_and_port(address)
        self._loop = loop
        self._socket: socket.socket | None = None
        self._on_bytes: OnBytes | None = None
        self._on_lost: OnLost | None = None

    @property
    def is_open(self) -> bool:
        """True from a successful open until closed or lost."""
        return self._socket is not None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Connect, unless connected. Raises LinkLost where no server listens."""
        self._on_bytes, self._on_lost = on_bytes, on_lost
        if self._socket is not None:
            return
        try:
            connection = socket.create_connection(self._address, CONNECT_TIMEOUT_S)
        except OSError as error:
            raise LinkLost(
                f"{self.name}: no server listens there: start rigctl serve ({error})"
            ) from error
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self._socket = connection
        self._loop.add_reader(connection, self._receive)

    def write(self, data: bytes) -> None:
        """Send bytes. Raises LinkLost where the connection is closed or broken."""
        if self._socket is None:
            raise LinkLost(f"{self.name}: the connection is closed: connect the board again")
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise LinkLost(f"{self.name}: the connection broke ({error})") from error

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
        self._socket = self._on_bytes = self._on_lost = None

    def _receive(self) -> None:
        assert self._socket is not None
        try:
            data = self._socket.recv(READ_SIZE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data and self._on_bytes is not None:
            self._on_bytes(data, self._loop.time())
        elif not data:
            on_lost = self._on_lost
            self.close()
            if on_lost is not None:
                on_lost(f"{self.name}: the other end closed the connection")


def _host_and_port(address: str) -> tuple[str, int]:
    host, colon, port = address.removeprefix(SCHEME).rpartition(":")
    if not address.startswith(SCHEME) or not colon or not port.isdecimal():
        raise ConfigError(f"{address}: write an address as tcp://127.0.0.1:5020")
    return host, int(port)
