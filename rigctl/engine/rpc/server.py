"""The engine's side: who is connected, what each sends, and which of them has control.

A client shows the engine's token in its first line; then each line is a request. What is queued for
a client that does not read is bounded, and no client can block the loop. The server sets no timer,
so clients that come and go change nothing in a simulated run.
"""

from __future__ import annotations

import asyncio
import hmac
import socket
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import msgspec
from msgspec import Meta

from rigctl.engine.rpc.commands import (
    ClientName,
    Number,
    RequestHandler,
    Result,
    declared_methods,
    read_arguments,
)
from rigctl.engine.rpc.engine_files import LOOPBACK
from rigctl.engine.rpc.messages import (
    DISCONNECTED,
    DISCONNECTED_TEXT,
    REQUEST_LIMIT_BYTES,
    Client,
    ControlState,
    EngineRequest,
    decode_request,
    encode_message,
    engine_message,
)
from rigctl.errors import RigctlError, WrongUse

MAX_CLIENTS = 64
MAX_UNDER_WAY = 64
"""Requests of one client that the engine executes at once; STOP is one more, always."""
STATUS_LIMIT_BYTES = 1 << 17
"""With more unread a client gets no status, which soon comes again."""
UNREAD_LIMIT_BYTES = 1 << 21
"""Events and replies are never left out: with more unread the engine disconnects the client."""
STOPPED_READING = "stopped reading and was disconnected"
KEPT_EVENTS = 500
"""Of the time before, for a client that joins."""
REFUSAL_LETTERS = 500
"""Of the longest refusal: it may cite a path of a request, which has up to 4096 letters."""
FIRST_CLIENT_TIMEOUT_S = 30.0
FREE_COMMANDS = frozenset({"stop", "abort", "status", "shown"})
"""Commands of the engine that need no control: they look, or make the rig safe."""
_BACKLOG = 8


class Login(msgspec.Struct):
    """The first line of a client: the token of the engine, and its own name, empty for none."""

    token: Annotated[str, Meta(max_length=128)]
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
        listener.listen(_BACKLOG)
    except OSError:  # a path has 108 bytes on Linux and 104 on macOS
        listener.close()
        return None
    return listener


def wait_first_client(
    listener: socket.socket, timeout_s: float = FIRST_CLIENT_TIMEOUT_S
) -> socket.socket | None:
    """Return the first connection that sends something, None where none comes in time.

    Simulated time starts later, so it does not matter when the client connects. Whoever only looks
    whether the engine is there sends nothing.
    """
    listener.settimeout(timeout_s)
    try:
        while True:
            connection, _ = listener.accept()
            connection.settimeout(timeout_s)
            with suppress(ConnectionError):
                if connection.recv(1, socket.MSG_PEEK):
                    connection.setblocking(False)
                    return connection
            connection.close()
    except TimeoutError:
        return None
    finally:
        listener.setblocking(False)


class Connection:
    """One client that has shown the token. ``number``: its own, never given again.

    It takes what is sent in its own time; nothing here waits for it.
    """

    def __init__(self, number: int, writer: asyncio.StreamWriter, name: str = "") -> None:
        self.number, self.name = number, name or f"client {number}"
        self.under_way = 0
        self.only_stops = self._has_asked = False
        self._writer = writer

    @property
    def unread_bytes(self) -> int:
        """Bytes that the client has not read yet."""
        return int(self._writer.transport.get_write_buffer_size())

    def note_request(self, command: str) -> None:
        """Take note of a request; ``only_stops``: whether all of them were STOP."""
        self.only_stops = command == "stop" and (self.only_stops or not self._has_asked)
        self._has_asked = True

    @property
    def is_closing(self) -> bool:
        """Whether it gets nothing any more."""
        return self._writer.is_closing()

    def send(self, line: bytes) -> None:
        """Send an event or a reply."""
        if not self.is_closing:
            self._writer.write(line)

    def send_status(self, line: bytes) -> None:
        """Send a status, or leave it out where the client is behind: a newer one comes soon."""
        if self.unread_bytes <= STATUS_LIMIT_BYTES:
            self.send(line)

    def close(self) -> None:
        """Close the connection once the client has read what it was sent."""
        self._writer.close()

    def abort(self) -> None:
        """Close the connection with what is unread."""
        self._writer.transport.abort()


class SharedEngine(Protocol):
    """An engine as its clients see it."""

    def past_events(self, count: int) -> list[dict[str, Any]]:
        """Return the newest events with their ages in s, the oldest first."""

    def end_if_unused(self, text: str) -> bool:
        """End the engine where it has one client and no run; return whether it ends."""


class Server:
    """All clients of one engine. ``handle`` executes the commands that go to the engine itself.

    ``report_failure``: gets a sentence on each request that failed inside the engine.
    ``control_changed``: gets one on each change of who has control.
    """

    def __init__(
        self, report_failure: Callable[[str], None], control_changed: Callable[[str], None]
    ) -> None:
        self._report_failure = report_failure
        self.control = Control(control_changed)
        self._greeting: dict[str, Any] | None = None
        self._clients: set[Connection] = set()
        self._last_number = 0
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(
        self,
        listener: socket.socket,
        token: str,
        engine: SharedEngine,
        handle: RequestHandler,
        first: socket.socket | None = None,
    ) -> None:
        """Serve whoever shows the token, from now on; ``first``: a connection from before."""
        self._token, self._engine, self._handle = token.encode(), engine, handle
        self._server = await asyncio.start_server(
            self._serve, sock=listener, limit=REQUEST_LIMIT_BYTES
        )
        if first is not None:
            reader, writer = await asyncio.open_connection(sock=first, limit=REQUEST_LIMIT_BYTES)
            client = await self._log_in(reader, writer)
            if client is not None:
                self._spawn(self._serve_client(reader, client))

    async def close(self) -> None:
        """Let nobody in any more, send what clients can take now, close all connections."""
        if self._server is not None:
            self._server.close()
        clients = tuple(self._clients)
        for client in clients:
            client.close()
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for client in clients:
            if client.unread_bytes:
                client.abort()
        await asyncio.sleep(0)

    def __len__(self) -> int:
        return sum(not client.is_closing for client in self._clients)

    @property
    def users(self) -> int:
        """The number of clients that came for more than a STOP."""
        return sum(not (client.is_closing or client.only_stops) for client in self._clients)

    def set_greeting(self, message: dict[str, Any]) -> None:
        """Send a message to every present client, and to each future one when it connects."""
        self._greeting = message
        self.broadcast(message)

    def broadcast(self, message: dict[str, Any]) -> None:
        """Send a message to every client."""
        line = encode_message(message) if self._clients else b""
        for client in tuple(self._clients):
            self._send(client, line)

    def broadcast_status(self, message: dict[str, Any]) -> None:
        """Send a status to every client that keeps up."""
        line = encode_message(message) if self._clients else b""
        for client in self._clients:
            client.send_status(line)

    def _send(self, client: Connection, line: bytes) -> None:
        """Send an event or a reply; a client that has left too much unread is disconnected."""
        client.send(line)
        if client.unread_bytes > UNREAD_LIMIT_BYTES and not client.is_closing:
            client.send(encode_message(engine_message(DISCONNECTED, DISCONNECTED_TEXT, {})))
            client.close()
            self.control.leave(client.number, STOPPED_READING)

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        self._keep(asyncio.get_running_loop().create_task(work))

    def _keep(self, task: asyncio.Task[None]) -> None:
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection until it ends."""
        task: asyncio.Task[None] | None = asyncio.current_task()
        assert task is not None
        self._keep(task)
        try:
            client = await self._log_in(reader, writer)
            if client is not None:
                await self._serve_client(reader, client)
        finally:
            writer.close()

    async def _log_in(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> Connection | None:
        """Return the client of a connection whose first line has the token, else close it."""
        try:
            login = msgspec.json.decode(await reader.readline(), type=Login)
        except (OSError, ValueError, RecursionError):
            login = None
        is_known = login is not None and hmac.compare_digest(login.token.encode(), self._token)
        if login is None or not is_known or self._is_full():
            writer.close()
            return None
        self._last_number += 1
        client = Connection(self._last_number, writer, login.name)
        self._clients.add(client)
        if self._greeting is not None:
            client.send(encode_message(self._greeting))
        return client

    def _is_full(self) -> bool:
        """Return whether there is no room for another client; those that left make room."""
        if len(self._clients) >= MAX_CLIENTS:
            for client in self._clients:
                if client.is_closing:
                    client.abort()
        return len(self) >= MAX_CLIENTS

    async def _serve_client(self, reader: asyncio.StreamReader, client: Connection) -> None:
        """Serve one client until it leaves; its requests may overtake each other."""
        commands = ClientCommands(client, self._engine, self.control, self._handle)
        try:
            while line := await self._read_line(reader, client):
                self._spawn(self._reply(client, commands, line))
        except OSError:
            pass  # the client has gone
        finally:
            self._clients.discard(client)
            client.close()
            self.control.leave(client.number)

    async def _read_line(self, reader: asyncio.StreamReader, client: Connection) -> bytes:
        """Return the next line, empty at the end; refuse what is too long for a request."""
        while True:
            try:
                return await reader.readline()
            except ValueError:  # the reader has dropped what it had of the line
                error = WrongUse(f"a request has at most {REQUEST_LIMIT_BYTES} bytes: send less")
                self._send(client, _refusal(None, error))

    async def _reply(self, client: Connection, commands: ClientCommands, line: bytes) -> None:
        try:
            request = decode_request(line)
        except WrongUse as error:
            self._send(client, _refusal(None, error))
            return
        if client.under_way >= MAX_UNDER_WAY and request.command != "stop":
            full = WrongUse(f"{MAX_UNDER_WAY} requests are under way: wait for their replies")
            self._send(client, _refusal(request.id, full))
            return
        client.under_way += 1
        client.note_request(request.command)
        try:
            self._send(client, await self._answer(commands, request))
        finally:
            client.under_way -= 1

    async def _answer(self, commands: ClientCommands, request: EngineRequest) -> bytes:
        """Return the reply to a request, whatever happens to it."""
        try:
            result = await commands.handle(request.command, request.args)
            return encode_message({"reply": request.id, "ok": True, "result": result})
        except RigctlError as error:
            return _refusal(request.id, error)
        except Exception as error:  # noqa: BLE001 - top of a task: the client must get a reply
            cause = _cut(repr(error))
            text = f"command {request.command} failed inside the engine, which goes on: {cause}"
            self._report_failure(f"{text}; report it")
            refusal = {"ok": False, "error": f"{text}; report it", "exit_code": 3}
            return encode_message({"reply": request.id, **refusal})


class Control:
    """Which clients an engine has and which one of them has control; the others watch.

    Everybody may look, stop the rig and abort a run. Everything else needs control: the first
    client has it, gives it to one that asks or loses it to one that takes it, and leaves it behind
    when it goes. ``changed`` gets one sentence on each change.
    """

    def __init__(self, changed: Callable[[str], None]) -> None:
        self._changed = changed
        self._names: dict[int, str] = {}
        self._asking: list[int] = []
        self._holder: int | None = None

    @property
    def state(self) -> ControlState:
        """The clients that have told their names, and who has control."""
        clients = tuple(Client(number, name) for number, name in self._names.items())
        return ControlState(clients, self._holder, tuple(self._asking))

    def join(self, client: int, name: str) -> None:
        """Add a client by its name; it gets control where nobody has it."""
        known = client in self._names
        self._names[client] = name
        if self._holder is None:
            self._holder = client
            self._changed(f"{name} has joined and has control")
        elif not known:
            self._changed(f"{name} has joined and watches")

    def leave(self, client: int, why: str = "has left") -> None:
        """Remove a client; control goes to the one that asked first, else to nobody."""
        name = self._names.pop(client, None)
        self._asking = [number for number in self._asking if number != client]
        if client == self._holder:
            self._holder = self._asking.pop(0) if self._asking else None
            self._changed(f"{name or f'client {client}'} {why}; {self._who()} has control")
        elif name is not None:
            self._changed(f"{name} {why}")

    def require(self, client: int, name: str) -> None:
        """Let a client act that has control, or gets it as nobody has. Raises WrongUse."""
        if self._holder is None:
            self.take(client, name)
        if self._holder != client:
            raise WrongUse(
                f"{self._who()} has control and this client only watches: ask for control, or "
                "take it first"
            )

    def ask(self, client: int, name: str) -> None:
        """Ask the holder for control; where nobody has it, the client gets it."""
        if self._holder is None:
            self.take(client, name)
        elif client not in (self._holder, *self._asking):
            self._names.setdefault(client, name)
            self._asking.append(client)
            self._changed(f"{self._names[client]} asks for control; {self._who()} has it")

    def take(self, client: int, name: str) -> None:
        """Give a client control, whoever has it: the holder may hang, or be far away."""
        if self._holder != client:
            before = "" if self._holder is None else f" from {self._who()}"
            self._names.setdefault(client, name)
            self._hand_to(client)
            self._changed(f"{self._who()} has taken control{before}")

    def give(self, to: int) -> None:
        """Hand control over. Raises WrongUse where ``to`` is nobody."""
        if to not in self._names:
            raise WrongUse(f"there is no client {to}: it may have left")
        if to != self._holder:
            before = self._who()
            self._hand_to(to)
            self._changed(f"{before} has given control to {self._who()}")

    def _hand_to(self, client: int) -> None:
        self._holder = client
        self._asking = [number for number in self._asking if number != client]

    def _who(self) -> str:
        return "nobody" if self._holder is None else self._names[self._holder]


class ClientCommands:
    """Executes what one client asks about itself and the others; ``handle`` does all the rest."""

    def __init__(
        self, client: Connection, engine: SharedEngine, control: Control, handle: RequestHandler
    ) -> None:
        self._client, self._engine, self._control = client, engine, control
        self._handle = handle
        self._commands = declared_methods(type(self))

    async def handle(self, command: str, args: dict[str, Any]) -> Result:
        """Execute one request. Raises WrongUse for wrong arguments or without control."""
        client = self._client
        own = self._commands.get(command)
        if own is not None:
            arguments = read_arguments(f"command {command}", own.arguments, args)
            return await own.execute(self, arguments) or {}
        if command not in FREE_COMMANDS:
            self._control.require(client.number, client.name)
        return await self._handle(command, args, client.name)

    async def on_introduce(self, name: ClientName) -> Result:
        """Tell the other clients a name; return the client's number, and who has control."""
        self._client.name = name
        self._control.join(self._client.number, name)
        return {"client": self._client.number, "control": self._control.state}

    async def on_clients(self) -> Result:
        """Return the clients that have told their names, and who has control."""
        return asdict(self._control.state)

    async def on_history(self, count: Annotated[int, Meta(ge=0, le=KEPT_EVENTS)] = 200) -> Result:
        """Return the newest events with their ages, the oldest first."""
        return {"events": self._engine.past_events(count)}

    async def on_ask_control(self) -> None:
        """Ask the client that has control for it."""
        self._control.ask(self._client.number, self._client.name)

    async def on_take_control(self) -> None:
        """Take control, whoever has it."""
        self._control.take(self._client.number, self._client.name)

    async def on_give_control(self, to: Number) -> None:
        """Hand control to another client."""
        self._control.require(self._client.number, self._client.name)
        self._control.give(to)

    async def on_leave(self) -> Result:
        """End the engine, where this is its only client and nothing runs; say whether it ends."""
        return {"ends": self._engine.end_if_unused("its last client has left")}


def _refusal(number: int | None, error: RigctlError) -> bytes:
    refusal = {"ok": False, "error": _cut(str(error)), "exit_code": error.exit_code}
    return encode_message({"reply": number, **refusal})


def _cut(text: str) -> str:
    """Return a sentence without its middle where it is too long; its cure is at its end."""
    half = REFUSAL_LETTERS // 2
    return text if len(text) <= REFUSAL_LETTERS else f"{text[: half - 1]}…{text[-half:]}"
