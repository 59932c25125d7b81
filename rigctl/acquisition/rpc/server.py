"""The engine's door: clients come with a token, ask one JSON line at a time, and are told events.

A client that does not read is dropped before it costs memory; no client can make the loop wait.
Nothing here sets a timer, so a client's coming and going leaves no trace in a simulated run.
"""

from __future__ import annotations

import asyncio
import hmac
import socket
from collections.abc import Awaitable, Callable
from typing import Any

from rigctl.acquisition.rpc.messages import LINE_LIMIT_BYTES, decode_message, encode_message
from rigctl.errors import RigctlError, WrongUse

UNREAD_LIMIT_BYTES = 4 << 20
FIRST_CLIENT_S = 30.0
Handler = Callable[[str, dict[str, Any]], Awaitable[dict[str, Any]]]


def listen() -> socket.socket:
    """A listening socket on a free port of this machine's loopback."""
    listener = socket.create_server(("127.0.0.1", 0), backlog=8)
    listener.setblocking(False)
    return listener


def await_client(
    listener: socket.socket, token: str, limit_s: float = FIRST_CLIENT_S
) -> socket.socket | None:
    """Wait, before any loop runs, for the first client that shows the token; None if none came."""
    listener.settimeout(limit_s)
    try:
        connection, _ = listener.accept()
    except OSError:
        return None
    finally:
        listener.setblocking(False)
    if _shows(connection, token, limit_s):
        connection.setblocking(False)
        return connection
    connection.close()
    return None


def _shows(connection: socket.socket, token: str, limit_s: float) -> bool:
    """Whether the first line that comes holds the token."""
    connection.settimeout(limit_s)
    try:
        with connection.makefile("rb", buffering=0) as lines:
            message = decode_message(lines.readline(LINE_LIMIT_BYTES))
    except (OSError, ValueError):
        return False
    return _is_token(message.get("token"), token)


class Server:
    """All clients of one engine.

    ``handle(command, args)`` answers a request with a result or raises RigctlError.
    """

    def __init__(self, token: str, handle: Handler) -> None:
        self._token = token
        self._handle = handle
        self._greeting: dict[str, Any] | None = None
        self._clients: set[_Client] = set()
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, listener: socket.socket, first: socket.socket | None) -> None:
        """Serve who comes to ``listener``, and ``first`` who came and showed the token already."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Client(self), sock=listener)
        if first is not None:
            await loop.connect_accepted_socket(lambda: _Client(self, known=True), first)

    async def close(self) -> None:
        """Let the last words out, then send everybody away."""
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.close()
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def __len__(self) -> int:
        return len(self._clients)

    def welcome(self, message: dict[str, Any]) -> None:
        """Tell every client that is there, and later each one that comes."""
        self._greeting = message
        self.broadcast(message)

    def broadcast(self, message: dict[str, Any]) -> None:
        """Tell every client."""
        if not self._clients:
            return
        line = encode_message(message)
        for client in tuple(self._clients):
            client.write(line)

    def knows(self, token: object) -> bool:
        """Whether a client showed the right token."""
        return _is_token(token, self._token)

    def came(self, client: _Client) -> None:
        """A client showed its token."""
        self._clients.add(client)
        if self._greeting is not None:
            client.write(encode_message(self._greeting))

    def left(self, client: _Client) -> None:
        """A connection ended."""
        self._clients.discard(client)

    def answer(self, client: _Client, message: dict[str, Any]) -> None:
        """Have a request answered; requests of one client may overtake each other."""
        task = asyncio.get_running_loop().create_task(self._answer(client, message))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, client: _Client, message: dict[str, Any]) -> None:
        number, args = message.get("id"), message.get("args", {})
        try:
            if not isinstance(args, dict):
                raise WrongUse("a request's args are a JSON object")
            result = await self._handle(str(message.get("command")), args)
        except RigctlError as error:
            reply = {"ok": False, "error": str(error), "exit_code": error.exit_code}
            client.write(encode_message({"reply": number, **reply}))
        except Exception as error:  # noqa: BLE001 - top of a task: the asker must learn of it
            text = f"the engine failed inside: {error!r}; report this"
            client.write(encode_message({"reply": number, "ok": False, "error": text}))
        else:
            client.write(encode_message({"reply": number, "ok": True, "result": result}))


class _Client(asyncio.Protocol):
    """One connection; strangers are cut off at their first line."""

    def __init__(self, server: Server, known: bool = False) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._received = b""
        self._known = known

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._known:
            self._server.came(self)

    def data_received(self, data: bytes) -> None:
        *lines, self._received = (self._received + data).split(b"\n")
        if len(self._received) > LINE_LIMIT_BYTES:
            self.close()
        for line in lines:
            self._take(line)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self._server.left(self)

    def write(self, line: bytes) -> None:
        """Send a line, or drop a client that has stopped reading."""
        if self._transport is None or self._transport.is_closing():
            return
        self._transport.write(line)
        if self._transport.get_write_buffer_size() > UNREAD_LIMIT_BYTES:
            self._transport.abort()

    def close(self) -> None:
        """End the connection once what was written is out."""
        if self._transport is not None:
            self._transport.close()

    def _take(self, line: bytes) -> None:
        try:
            message = decode_message(line)
        except ValueError:
            self.close()
            return
        if self._known:
            self._server.answer(self, message)
        elif self._server.knows(message.get("token")):
            self._known = True
            self._server.came(self)
        else:
            self.close()


def _is_token(shown: object, token: str) -> bool:
    return isinstance(shown, str) and hmac.compare_digest(shown, token)
