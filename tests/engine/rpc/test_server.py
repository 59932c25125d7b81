"""The engine's server: greeting, replies, refusals."""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest

from rigctl.engine.rpc.client import EngineClient
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.engine.rpc.messages import (
    REQUEST_LIMIT_BYTES,
    decode_message,
    encode_message,
)
from rigctl.engine.rpc.server import Server, open_listener, wait_first_client
from rigctl.errors import BoardFault, WrongUse
from tests.engine.engine_harness import EngineHarness

TOKEN = "a secret"
LOGIN = encode_message({"token": TOKEN})
STATUS = encode_message({"id": 9, "command": "status", "args": {}})


async def handle(command: str, args: dict[str, Any], by: str) -> dict[str, Any]:
    if command == "fail":
        raise BoardFault("the board said no: ask it kindly")
    if command == "crash":
        raise ZeroDivisionError
    if command == "strange":
        return {"force_g": object()}
    return {"command": command, **args}


class AnEngine:
    """An engine without a past, which goes on."""

    def past_events(self, count: int) -> list[dict[str, Any]]:
        return []

    def end_if_unused(self, text: str) -> bool:
        return False


async def talk(
    *lines: bytes, answers: int, failures: list[str] | None = None, until: int | None = None
) -> list[dict[str, Any]]:
    """Return the messages that a client gets for these lines, up to the reply to a request.

    Fewer where it is disconnected.
    """
    server = Server([].append if failures is None else failures.append, [].append)
    with open_listener() as listener:
        await server.open(listener, TOKEN, AnEngine(), handle)
        server.set_greeting({"event": "ready"})
        reader, writer = await asyncio.open_connection(*listener.getsockname())
        received = []
        with suppress(ConnectionError):
            writer.writelines(lines)
            while len(received) < answers and (line := await reader.readline()):
                received.append(decode_message(line))
                if until is not None and received[-1].get("reply") == until:
                    break
            writer.close()
            await writer.wait_closed()
        await server.close()
    return received


def exchange(*messages: dict[str, Any], answers: int) -> list[dict[str, Any]]:
    return asyncio.run(talk(*map(encode_message, messages), answers=answers))


def test_a_client_with_the_token_gets_greeting_and_replies() -> None:
    received = exchange(
        {"token": TOKEN},
        {"id": 1, "command": "arm", "args": {"gently": 1}},
        {"id": 2, "command": "fail", "args": {}},
        answers=3,
    )
    assert received[0] == {"event": "ready"}
    assert received[1] == {"reply": 1, "ok": True, "result": {"command": "arm", "gently": 1}}
    assert received[2]["error"] == "the board said no: ask it kindly"
    assert (received[2]["ok"], received[2]["exit_code"]) == (False, 3)


@pytest.mark.parametrize(
    ("command", "error"), [("crash", "ZeroDivisionError"), ("strange", "TypeError")]
)
def test_a_request_that_fails_inside_is_answered_and_reported(command: str, error: str) -> None:
    failures: list[str] = []
    request = encode_message({"id": 1, "command": command})
    received = asyncio.run(talk(LOGIN, request, STATUS, answers=3, failures=failures))
    assert f"command {command} failed inside the engine, which goes on" in received[1]["error"]
    assert error in received[1]["error"]
    assert received[1]["exit_code"] == 3
    assert received[2]["ok"]
    assert failures == [received[1]["error"]]


@pytest.mark.parametrize(
    "first",
    [
        b'{"token":"wrong"}',
        b'{"id":1,"command":"stop"}',
        b'{"token":7}',
        '{"token":"é"}'.encode(),
        b"[" * 60_000,
        b"x" * 1_000_000,
        b'{"token":"\\ud800"}',
        b'{"token":NaN}',
        b"\xff\xfe",
        b"",
        b"GET / HTTP/1.1",
    ],
    ids=lambda line: repr(line[:30]),
)
def test_a_client_without_the_token_is_disconnected(first: bytes) -> None:
    assert asyncio.run(talk(first + b"\n", STATUS, answers=2)) == []


@pytest.mark.parametrize(
    "line",
    [
        b"[1, 2]",
        b"",
        b"\xff\xfe",
        b"[" * 60_000,
        b'{"id":1,"command":"arm","args":' + b'{"a":' * 10_000,
        b'{"id":1,"command":"arm","args":{"a":NaN}}',
        b'{"id":1,"command":"arm","args":{"a":1e999}}',
        b'{"id":1,"command":"arm","args":{"a":-Infinity}}',
        b'{"id":1,"command":"arm","args":{"a":"\\ud800"}}',
        b'{"id":1,"command":"arm","args":[1]}',
        b'{"id":1,"command":"arm","args":null}',
        b'{"id":1,"command":["arm"]}',
        b'{"id":1,"command":"' + b"a" * 65 + b'"}',
        b'{"id":1}',
        b'{"command":"arm"}',
        b'{"id":[1],"command":"arm"}',
        b'{"id":-1,"command":"arm"}',
        b'{"id":1.5,"command":"arm"}',
        b'{"id":true,"command":"arm"}',
        b'{"id":1' + b"0" * 400 + b',"command":"arm"}',
        b'{"id":1' + b"0" * 9000 + b',"command":"arm"}',
        b'{"id":1,"command":"arm","sudo":true}',
    ],
    ids=lambda line: repr(line[:50]),
)
def test_a_line_that_is_no_request_is_refused_and_the_connection_stays(line: bytes) -> None:
    failures: list[str] = []
    received = asyncio.run(talk(LOGIN, line + b"\n", STATUS, answers=3, failures=failures))
    assert received[1]["reply"] is None
    assert received[1]["error"].startswith("this is no request")
    assert received[1]["exit_code"] == WrongUse.exit_code
    assert received[2]["ok"] and received[2]["reply"] == 9
    assert failures == []


def test_a_repeated_key_has_its_last_value() -> None:
    line = b'{"id":1,"command":"arm","command":"tare"}\n'
    received = asyncio.run(talk(LOGIN, line, answers=2))
    assert received[1]["result"] == {"command": "tare"}


def test_too_long_a_line_is_refused_and_the_connection_stays() -> None:
    line = b" " * (2 * REQUEST_LIMIT_BYTES) + b"\n"
    received = asyncio.run(talk(LOGIN, line, STATUS, answers=9, until=9))
    assert "at most 65536 bytes" in received[1]["error"]
    assert received[-1]["ok"]


def test_a_request_in_the_same_packet_as_the_token_is_answered() -> None:
    received = asyncio.run(talk(LOGIN + STATUS, answers=2))
    assert received[1]["reply"] == 9


@pytest.mark.parametrize(
    "line",
    [
        b'{"id":1,"command":"status","args":{"' + b"n" * 60_000 + b'":1}}\n',
        b'{"id":1,"command":"status","' + b"n" * 60_000 + b'":1}\n',
        b'{"id":1,"command":"answer","args":{"prompt_id":1,"answer":"' + b"n" * 60_000 + b'"}}\n',
        b'{"id":1,"command":"start","args":{"protocol":"' + b"n/" * 2000 + b'"}}\n',
        b'{"id":1,"command":"' + b"\\u0000" * 64 + b'"}\n',
        b'{"id":1,"command":"inject","args":{"fault":"push","' + b"n" * 60_000 + b'":1}}\n',
    ],
)
async def test_a_refusal_cites_little_of_a_request(line: bytes, harness: EngineHarness) -> None:
    reader, writer = await asyncio.open_connection(*harness.address)
    writer.write(b'{"token":"token"}\n' + line)
    while "reply" not in (message := decode_message(await reader.readline())):
        pass
    writer.close()
    await writer.wait_closed()
    assert not message["ok"] and message["exit_code"] == 2
    assert 20 < len(message["error"]) <= 500 and "n" * 101 not in message["error"]


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[socket.socket]:
    with open_listener(tmp_path / "s") as opened:
        yield opened


def come(listener: socket.socket, sent: bytes) -> socket.socket:
    connection = socket.socket(listener.family)
    connection.connect(listener.getsockname())
    connection.sendall(sent)
    return connection


def test_the_first_client_is_the_first_that_sends_something(listener: socket.socket) -> None:
    """Another program that looks whether the engine is there was taken for its client."""
    come(listener, b"").close()
    with come(listener, LOGIN) as client:
        first = wait_first_client(listener)
        assert first is not None and first.recv(99) == LOGIN
        first.close()
        assert client.recv(1) == b""


def test_without_a_client_the_wait_ends(listener: socket.socket) -> None:
    assert wait_first_client(listener, timeout_s=0.05) is None


def test_the_first_client_is_served_among_silent_ones(listener: socket.socket) -> None:
    async def serve() -> list[dict[str, Any]]:
        server = Server([].append, [].append)
        with come(listener, LOGIN + STATUS) as client, come(listener, b'{"tok'):
            first = wait_first_client(listener)
            await server.open(listener, TOKEN, AnEngine(), handle, first)
            server.set_greeting({"event": "ready"})
            client.setblocking(False)
            reader, writer = await asyncio.open_connection(sock=client.dup())
            received = [decode_message(await reader.readline()) for _ in range(2)]
            writer.close()
            await writer.wait_closed()
            await server.close()
        return received

    ready, reply = asyncio.run(serve())
    assert ready == {"event": "ready"} and reply["reply"] == 9


async def test_clients_set_no_timer(
    listener: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    timers: list[float] = []
    loop = asyncio.get_running_loop()
    monkeypatch.setattr(loop, "call_at", lambda when, *_, **__: timers.append(when))
    server = Server([].append, [].append)
    await server.open(listener, TOKEN, AnEngine(), handle)
    with come(listener, b""), come(listener, LOGIN):
        while not len(server):
            await asyncio.sleep(0)
        await server.close()
    assert timers == []


def test_a_path_too_long_for_a_socket_gives_a_port(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    with open_listener(folder / "s") as listener:
        assert listener.getsockname()[0] == "127.0.0.1"
    assert list(folder.iterdir()) == []


def test_a_client_waits_where_others_are_in_the_queue(listener: socket.socket) -> None:
    """Its connection was refused at once when the queue of the socket was full."""
    path = listener.getsockname()
    engine = EngineFile("one", os.getpid(), 0, TOKEN, "virtual", "", socket=path)
    with ExitStack() as stack:
        queued = 0
        while True:
            other = stack.enter_context(socket.socket(socket.AF_UNIX))
            other.setblocking(False)
            try:
                other.connect(path)
            except BlockingIOError:
                break
            queued += 1
        clients: list[EngineClient] = []
        thread = threading.Thread(target=lambda: clients.append(EngineClient(engine)))
        thread.start()
        for _ in range(queued):
            listener.accept()[0].close()
        thread.join()
        clients[0].close()
