"""The engine's door: strangers show the token, side by side, a few at a time, and become clients.

The door sets no timer, so strangers change nothing in a simulated run: instead of a time limit,
the one who has been silent longest is dropped when there are too many. One stranger is let in a
turn of the loop, so none can delay what the loop does.
"""

from __future__ import annotations

import asyncio
import hmac
import os
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import msgspec
from msgspec import Meta

from rigctl.acquisition.rpc.arguments import ClientName
from rigctl.acquisition.rpc.engine_files import LOOPBACK

MAX_STRANGERS = 32
"""More than the system queues, so that who shows the token without delay is never dropped."""
LOGIN_LIMIT_BYTES = 512
FIRST_CLIENT_TIMEOUT_S = 30.0
_BACKLOG = 8
_CREDENTIALS = struct.Struct("3i")  # process, user, group


class LoggedIn(NamedTuple):
    """A connection that has shown the token, what came behind the token's line, and who it is."""

    connection: socket.socket
    rest: bytes
    name: str


class Login(msgspec.Struct):
    """The first line of a client: the token of the engine, and its own name, empty for none."""

    token: Annotated[str, Meta(max_length=LOGIN_LIMIT_BYTES)]
    name: ClientName | Literal[""] = ""


def open_listener(path: Path | None = None) -> socket.socket:
    """Return a listening socket at this path, or on a free port of this machine's loopback.

    A system without such sockets, or with too long a path for one, gets the port.
    """
    listener = _open_unix_listener(path) if path is not None else None
    if listener is None:
        listener = socket.create_server((LOOPBACK, 0), backlog=_BACKLOG)
    listener.setblocking(False)
    return listener


def _open_unix_listener(path: Path) -> socket.socket | None:
    if not hasattr(socket, "AF_UNIX"):
        return None
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
        path.chmod(0o600)
        listener.listen(_BACKLOG)
    except OSError:  # a path has 108 bytes on Linux and 104 on macOS
        listener.close()
        return None
    return listener


class Door:
    """A listening socket, the token that clients must show, and the strangers before the door."""

    def __init__(self, listener: socket.socket, token: str) -> None:
        self._listener = listener
        self._token = token.encode()
        self._strangers: dict[socket.socket, bytes] = {}  # what each has sent, the oldest first
        self._logged_in: list[LoggedIn] = []
        self._loop: asyncio.AbstractEventLoop | None = None

    def open(self, loop: asyncio.AbstractEventLoop, admit: Callable[[LoggedIn], None]) -> None:
        """Call ``admit`` for each client that logs in from now on."""
        self._loop, self._admit = loop, admit
        loop.add_reader(self._listener, self._accept, loop)
        for stranger in self._strangers:
            loop.add_reader(stranger, self._read, loop, stranger)

    def pause(self) -> None:
        """Let nobody in until :meth:`open`; strangers wait."""
        if self._loop is not None:
            for connection in (self._listener, *self._strangers):
                self._loop.remove_reader(connection)
            self._loop = None

    def take_clients(self) -> tuple[LoggedIn, ...]:
        """Return the clients that :meth:`wait_first_client` let in."""
        taken = tuple(self._logged_in)
        self._logged_in.clear()
        return taken

    def close(self) -> None:
        """Send the strangers away; the listening socket stays its owner's."""
        self.pause()
        for connection in (*self._strangers, *(client.connection for client in self._logged_in)):
            connection.close()
        self._strangers.clear()
        self._logged_in.clear()

    def wait_first_client(self, timeout_s: float = FIRST_CLIENT_TIMEOUT_S) -> bool:
        """Wait for the first client before the engine's loop runs; return whether one came."""
        with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
            return runner.run(self._first_client(timeout_s))

    async def _first_client(self, timeout_s: float) -> bool:
        came = asyncio.Event()

        def admit(client: LoggedIn) -> None:
            self._logged_in.append(client)
            came.set()

        self.open(asyncio.get_running_loop(), admit)
        with suppress(TimeoutError):
            await asyncio.wait_for(came.wait(), timeout_s)
        self.pause()
        return came.is_set()

    def _accept(self, loop: asyncio.AbstractEventLoop) -> None:
        """Let one stranger come before the door."""
        try:
            connection, _ = self._listener.accept()
        except OSError:  # it has gone again, or there are too many open files
            self._drop_oldest(loop)
            return
        if _is_foreign(connection):
            connection.close()
            return
        if len(self._strangers) >= MAX_STRANGERS:
            self._drop_oldest(loop)
        connection.setblocking(False)
        self._strangers[connection] = b""
        loop.add_reader(connection, self._read, loop, connection)

    def _read(self, loop: asyncio.AbstractEventLoop, stranger: socket.socket) -> None:
        """Read up to the end of the first line; then admit the stranger or send it away."""
        try:
            data = stranger.recv(LOGIN_LIMIT_BYTES - len(self._strangers[stranger]))
        except BlockingIOError:
            return
        except OSError:
            data = b""
        received = self._strangers[stranger] = self._strangers[stranger] + data
        line, newline, rest = received.partition(b"\n")
        if newline or not data or len(received) >= LOGIN_LIMIT_BYTES:
            loop.remove_reader(stranger)
            del self._strangers[stranger]
            login = self._read_login(line) if newline else None
            if login is not None:
                self._admit(LoggedIn(stranger, rest, login.name))
            else:
                stranger.close()

    def _read_login(self, line: bytes) -> Login | None:
        """Return a client's first line if it holds the token."""
        try:
            login = msgspec.json.decode(line, type=Login)
        except (ValueError, RecursionError):
            return None
        return login if hmac.compare_digest(login.token.encode(), self._token) else None

    def _drop_oldest(self, loop: asyncio.AbstractEventLoop) -> None:
        oldest = next(iter(self._strangers), None)
        if oldest is not None:
            loop.remove_reader(oldest)
            del self._strangers[oldest]
            oldest.close()


def _is_foreign(connection: socket.socket) -> bool:
    """Return whether the kernel says that another user has connected."""
    if connection.family == socket.AF_INET or not hasattr(socket, "SO_PEERCRED"):
        return False
    peer = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, user, _ = _CREDENTIALS.unpack(peer)
    return bool(user != os.getuid())
