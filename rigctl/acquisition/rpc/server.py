"""The engine's server: clients log in with a token, send one JSON line per request, get events.

The server drops a client that does not read before it costs memory; no client can block the loop.
It sets no timer, so clients that come and go change nothing in a simulated run.
"""

from __future__ import annotations

import asyncio
import hmac
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from rigctl.acquisition.rpc.messages import LINE_LIMIT_BYTES, decode_message, encode_message
from rigctl.errors import RigctlError, WrongUse

UNREAD_LIMIT_BYTES = 4 << 20
FIRST_CLIENT_TIMEOUT_S = 30.0
RequestHandler = Callable[[str, dict[str, Any]], Awaitable[dict[str, Any]]]


@dataclass(frozen=True, slots=True)
class EngineAddress:
    """A listening socket, the token that clients must show, and the first client, if connected."""

    listener: socket.socket
    token: str
    first_client: socket.socket | None = None


def open_listener() -> socket.socket:
    """Return a listening socket on a free port of this machine's loopback."""
    listener = socket.create_server(("127.0.0.1", 0), backlog=8)
    listener.setblocking(False)
    return listener


def accept_first_client(
    listener: socket.socket, token: str, timeout_s: float = FIRST_CLIENT_TIMEOUT_S
) -> socket.socket | None:
    """Return the first client, accepted before the loop runs; None without one or its token."""
    listener.settimeout(timeout_s)
    try:
        connection, _ = listener.accept()
    except OSError:
        return None
    finally:
        listener.setblocking(False)
    if _reads_token(connection, token, timeout_s):
        connection.setblocking(False)
        return connection
    connection.close()
    return None


def _reads_token(connection: socket.socket, token: str, timeout_s: float) -> bool:
    """Read the first line and return whether it holds the token."""
    connection.settimeout(timeout_s)
    try:
        with connection.makefile("rb", buffering=0) as lines:
            message = decode_message(lines.readline(LINE_LIMIT_BYTES))
    except (OSError, ValueError):
        return False
    return _is_token(message.get("token"), token)


def _is_token(received: object, token: str) -> bool:
    return isinstance(received, str) and hmac.compare_digest(received, token)


class Server:
    """All clients of one engine."""

    def __init__(self) -> None:
        self._greeting: dict[str, Any] | None = None
        self._clients: set[_Connection] = set()
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, address: EngineAddress, handle: RequestHandler) -> None:
        """Serve new connections, and a first client whose token was checked already.

        ``handle(command, args)`` returns the result of a request or raises RigctlError.
        """
        loop = asyncio.get_running_loop()
        self._token, self._handle = address.token, handle
        self._server = await loop.create_server(lambda: _Connection(self), sock=address.listener)
        if address.first_client is not None:
            connection = _Connection(self, logged_in=True)
            await loop.connect_accepted_socket(lambda: connection, address.first_client)

    async def close(self) -> None:
        """Send what is written, then close all connections."""
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.close()
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def __len__(self) -> int:
        return len(self._clients)

    def set_greeting(self, message: dict[str, Any]) -> None:
        """Send a message to every present client, and to each future one when it connects."""
        self._greeting = message
        self.broadcast(message)

    def broadcast(self, message: dict[str, Any]) -> None:
        """Send a message to every client."""
        if not self._clients:
            return
        line = encode_message(message)
        for client in tuple(self._clients):
            client.write(line)

    def is_token(self, token: object) -> bool:
        """Return whether a client sent the right token."""
        return _is_token(token, self._token)

    def add_client(self, client: _Connection) -> None:
        """Add a client that has sent its token."""
        self._clients.add(client)
        if self._greeting is not None:
            client.write(encode_message(self._greeting))

    def remove_client(self, client: _Connection) -> None:
        """Remove a client whose connection is closed."""
        self._clients.discard(client)

    def handle_request(self, client: _Connection, message: dict[str, Any]) -> None:
        """Start a task that replies; requests of one client may overtake each other."""
        task = asyncio.get_running_loop().create_task(self._reply(client, message))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _reply(self, client: _Connection, message: dict[str, Any]) -> None:
        args = message.get("args", {})
        reply: dict[str, Any]
        try:
            if not isinstance(args, dict):
                raise WrongUse("a request's args are a JSON object")
            reply = {"ok": True, "result": await self._handle(str(message.get("command")), args)}
        except RigctlError as error:
            reply = {"ok": False, "error": str(error), "exit_code": error.exit_code}
        except Exception as error:  # noqa: BLE001 - top of a task: the client must get a reply
            text = f"the engine failed inside: {error!r}; report this"
            reply = {"ok": False, "error": text}
        client.write(encode_message({"reply": message.get("id"), **reply}))


class _Connection(asyncio.Protocol):
    """One client's connection, closed at the first line without the token."""

    def __init__(self, server: Server, logged_in: bool = False) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._received = b""
        self._logged_in = logged_in

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._logged_in:
            self._server.add_client(self)

    def data_received(self, data: bytes) -> None:
        *lines, self._received = (self._received + data).split(b"\n")
        if len(self._received) > LINE_LIMIT_BYTES:
            self.close()
        for line in lines:
            self._handle_line(line)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self._server.remove_client(self)

    def write(self, line: bytes) -> None:
        """Send a line, or drop a client that has stopped reading."""
        if self._transport is None or self._transport.is_closing():
            return
        self._transport.write(line)
        if self._transport.get_write_buffer_size() > UNREAD_LIMIT_BYTES:
            self._transport.abort()

    def close(self) -> None:
        """Close the connection once the written lines are sent."""
        if self._transport is not None:
            self._transport.close()

    def _handle_line(self, line: bytes) -> None:
        try:
            message = decode_message(line)
        except ValueError:
            self.close()
            return
        if self._logged_in:
            self._server.handle_request(self, message)
        elif self._server.is_token(message.get("token")):
            self._logged_in = True
            self._server.add_client(self)
        else:
            self.close()
