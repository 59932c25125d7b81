"""The engine's server: clients that the door let in send one JSON line per request, get events.

What is queued for a client that does not read is bounded, and no client can block the loop.
It sets no timer, so clients that come and go change nothing in a simulated run.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Protocol

from rigctl.acquisition.rpc.door import Door, LoggedIn
from rigctl.acquisition.rpc.messages import (
    REQUEST_LIMIT_BYTES,
    EngineRequest,
    decode_request,
    encode_message,
)
from rigctl.acquisition.rpc.queues.connected_client import MAX_UNDER_WAY, ConnectedClient
from rigctl.errors import RigctlError, WrongUse

MAX_CLIENTS = 64
REFUSAL_LETTERS = 500
"""Of the longest refusal: it may cite a path of a request, which has up to 4096 letters."""
Reply = dict[str, Any]


class ClientDesk(Protocol):
    """What serves one client."""

    async def handle(self, command: str, args: dict[str, Any]) -> dict[str, Any]:
        """Return the result of a request. Raises RigctlError."""

    def close(self) -> None:
        """Take note that the client has left."""


DeskFactory = Callable[[ConnectedClient], ClientDesk]


class Server:
    """All clients of one engine.

    ``report_failure``: gets a sentence on each request that failed inside the engine.
    """

    def __init__(self, report_failure: Callable[[str], None]) -> None:
        self._report_failure = report_failure
        self._greeting: dict[str, Any] | None = None
        self._clients: set[ConnectedClient] = set()
        self._last_number = 0
        self._door: Door | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, door: Door, open_desk: DeskFactory) -> None:
        """Serve those whom the door lets in, from now on and before; each gets a desk."""
        self._door, self._open_desk = door, open_desk
        for client in door.take_clients():
            self._spawn(self._serve(*await self._connect(client)))
        door.open(asyncio.get_running_loop(), lambda client: self._spawn(self._admit(client)))

    async def close(self) -> None:
        """Send what clients can take now, then close all connections."""
        if self._door is not None:
            self._door.close()
        clients = tuple(self._clients)
        for client in clients:
            client.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for client in clients:
            client.abort_unread()
        await asyncio.sleep(0)

    def __len__(self) -> int:
        return sum(not client.is_dropped for client in self._clients)

    @property
    def users(self) -> int:
        """The number of clients that came for more than a STOP."""
        return sum(not (client.is_dropped or client.only_stops) for client in self._clients)

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
            client.send(line)

    def broadcast_status(self, message: dict[str, Any]) -> None:
        """Send a status to every client that keeps up."""
        line = encode_message(message) if self._clients else b""
        for client in tuple(self._clients):
            client.send_status(line)

    def tend(self, now_s: float) -> list[int]:
        """Tell clients what was left out; return the numbers of those disconnected just now."""
        return [client.number for client in tuple(self._clients) if client.tend(now_s)]

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _admit(self, client: LoggedIn) -> None:
        if len(self._clients) >= MAX_CLIENTS:
            client.connection.close()
            return
        await self._serve(*await self._connect(client))

    async def _connect(self, client: LoggedIn) -> tuple[asyncio.StreamReader, ConnectedClient]:
        """Add a client and greet it; return what it sends."""
        spare = client.connection.dup()
        reader, writer = await asyncio.open_connection(
            sock=client.connection, limit=REQUEST_LIMIT_BYTES
        )
        if client.rest:
            reader.feed_data(client.rest)
        self._last_number += 1
        connected = ConnectedClient(self._last_number, writer, spare, client.name)
        self._clients.add(connected)
        if self._greeting is not None:
            connected.send(encode_message(self._greeting))
        return reader, connected

    async def _serve(self, reader: asyncio.StreamReader, client: ConnectedClient) -> None:
        """Serve one client until it leaves; its requests may overtake each other."""
        desk = self._open_desk(client)
        try:
            while line := await self._read_line(reader, client):
                self._spawn(self._reply(client, desk, line))
        except OSError:  # the client has gone; a STOP that it sent before counts
            for line in filter(_is_stop, client.unread_lines()):
                self._spawn(self._reply(client, desk, line))
        finally:
            self._clients.discard(client)
            client.close()
            desk.close()

    async def _read_line(self, reader: asyncio.StreamReader, client: ConnectedClient) -> bytes:
        """Return the next line, empty at the end; refuse what is too long for a request."""
        while True:
            try:
                return await reader.readline()
            except ValueError:  # the reader has dropped what it had of the line
                error = WrongUse(f"a request has at most {REQUEST_LIMIT_BYTES} bytes: send less")
                client.send(encode_message({"reply": None, **_refusal(error)}))

    async def _reply(self, client: ConnectedClient, desk: ClientDesk, line: bytes) -> None:
        try:
            request = decode_request(line)
        except WrongUse as error:
            client.send(encode_message({"reply": None, **_refusal(error)}))
            return
        if client.under_way >= MAX_UNDER_WAY and request.command != "stop":
            full = WrongUse(f"{MAX_UNDER_WAY} requests are under way: wait for their replies")
            client.send(encode_message({"reply": request.id, **_refusal(full)}))
            return
        client.under_way += 1
        client.note_request(request.command)
        try:
            client.send(await self._answer(desk, request))
        finally:
            client.under_way -= 1

    async def _answer(self, desk: ClientDesk, request: EngineRequest) -> bytes:
        """Return the reply to a request, whatever happens to it."""
        try:
            result = await desk.handle(request.command, request.args)
            return encode_message({"reply": request.id, "ok": True, "result": result})
        except RigctlError as error:
            return encode_message({"reply": request.id, **_refusal(error)})
        except Exception as error:  # noqa: BLE001 - top of a task: the client must get a reply
            cause = _cut(repr(error))
            text = f"command {request.command} failed inside the engine, which goes on: {cause}"
            self._report_failure(f"{text}; report it")
            refusal = {"ok": False, "error": f"{text}; report it", "exit_code": 3}
            return encode_message({"reply": request.id, **refusal})


def _is_stop(line: bytes) -> bool:
    try:
        return decode_request(line).command == "stop"
    except WrongUse:
        return False


def _refusal(error: RigctlError) -> Reply:
    return {"ok": False, "error": _cut(str(error)), "exit_code": error.exit_code}


def _cut(text: str) -> str:
    """Return a sentence without its middle where it is too long; its cure is at its end."""
    half = REFUSAL_LETTERS // 2
    return text if len(text) <= REFUSAL_LETTERS else f"{text[: half - 1]}…{text[-half:]}"
