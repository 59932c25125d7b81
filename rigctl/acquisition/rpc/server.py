"""The engine's server: clients log in with a token, send one JSON line per request, get events.

The server drops a client that does not read before it costs memory; no client can block the loop.
It sets no timer, so clients that come and go change nothing in a simulated run.
"""

from __future__ import annotations

import asyncio
import hmac
import socket
from collections.abc import Awaitable, Callable, Coroutine
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
            return _has_token(lines.readline(LINE_LIMIT_BYTES), token)
    except OSError:
        return False


def _has_token(line: bytes, token: str) -> bool:
    """Return whether a client's first line holds the token."""
    try:
        received = decode_message(line).get("token")
    except ValueError:
        return False
    return isinstance(received, str) and hmac.compare_digest(received, token)


class Server:
    """All clients of one engine, by the stream that writes to each."""

    def __init__(self) -> None:
        self._greeting: dict[str, Any] | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, address: EngineAddress, handle: RequestHandler) -> None:
        """Serve new connections, and a first client whose token was checked already.

        ``handle(command, args)`` returns the result of a request or raises RigctlError.
        """
        self._token, self._handle = address.token, handle
        self._server = await asyncio.start_server(
            self._accept, sock=address.listener, limit=LINE_LIMIT_BYTES
        )
        if address.first_client is not None:
            reader, writer = await asyncio.open_connection(
                sock=address.first_client, limit=LINE_LIMIT_BYTES
            )
            self._add_client(writer)
            self._spawn(self._serve(reader, writer, logged_in=True))

    async def close(self) -> None:
        """Send what is written, then close all connections."""
        if self._server is not None:
            self._server.close()
        for client in self._clients:
            client.close()
        for task in self._tasks:
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
        for client in self._clients:
            _write(client, line)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _add_client(self, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        if self._greeting is not None:
            _write(writer, encode_message(self._greeting))

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._spawn(self._serve(reader, writer, logged_in=False))

    async def _serve(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, logged_in: bool
    ) -> None:
        """Serve one client until it leaves, sends an invalid line, or does not send the token.

        Requests of one client may overtake each other.
        """
        try:
            if not logged_in:
                if not _has_token(await reader.readline(), self._token):
                    return
                self._add_client(writer)
            while (line := await reader.readline()).endswith(b"\n"):
                self._spawn(self._reply(writer, decode_message(line)))
        except (ValueError, OSError):
            pass
        finally:
            self._clients.discard(writer)
            writer.close()

    async def _reply(self, client: asyncio.StreamWriter, message: dict[str, Any]) -> None:
        args = message.get("args", {})
        reply: dict[str, Any]
        try:
            if not isinstance(args, dict):
                raise WrongUse("a request's args must be a JSON object")
            reply = {"ok": True, "result": await self._handle(str(message.get("command")), args)}
        except RigctlError as error:
            reply = {"ok": False, "error": str(error), "exit_code": error.exit_code}
        except Exception as error:  # noqa: BLE001 - top of a task: the client must get a reply
            text = f"internal error of the engine: {error!r}; report it"
            reply = {"ok": False, "error": text}
        _write(client, encode_message({"reply": message.get("id"), **reply}))


def _write(client: asyncio.StreamWriter, line: bytes) -> None:
    """Send a line, or drop a client that has stopped reading."""
    if client.is_closing():
        return
    client.write(line)
    if client.transport.get_write_buffer_size() > UNREAD_LIMIT_BYTES:
        client.transport.abort()
