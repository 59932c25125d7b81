"""The engine's server: greeting, replies, refusals."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Any

import pytest

from rigctl.acquisition.rpc.door import Door, open_listener
from rigctl.acquisition.rpc.messages import (
    REQUEST_LIMIT_BYTES,
    decode_message,
    encode_message,
)
from rigctl.acquisition.rpc.server import ConnectedClient, Server
from rigctl.errors import BoardFault, WrongUse
from tests.acquisition.engine_harness import EngineHarness

TOKEN = "a secret"
LOGIN = encode_message({"token": TOKEN})
STATUS = encode_message({"id": 9, "command": "status", "args": {}})


async def handle(command: str, args: dict[str, Any]) -> dict[str, Any]:
    if command == "fail":
        raise BoardFault("the board said no: ask it kindly")
    if command == "crash":
        raise ZeroDivisionError
    if command == "endless":
        return {"force_g": float("nan")}
    return {"command": command, **args}


class OneDesk:
    """Serves every client in the same way."""

    def __init__(self, client: ConnectedClient) -> None:
        self.handle = handle

    def close(self) -> None:
        """The client has left."""


async def talk(
    *lines: bytes, answers: int, failures: list[str] | None = None, until: int | None = None
) -> list[dict[str, Any]]:
    """Return the messages that a client gets for these lines, up to the reply to a request.

    Fewer where it is disconnected.
    """
    server = Server([].append if failures is None else failures.append)
    with open_listener() as listener:
        await server.open(Door(listener, TOKEN), OneDesk)
        server.set_greeting({"event": "ready"})
        reader, writer = await asyncio.open_connection(*listener.getsockname())
        writer.writelines(lines)
        received = []
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
    ("command", "error"), [("crash", "ZeroDivisionError"), ("endless", "ValueError")]
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


@pytest.mark.parametrize("first", [{"token": "wrong"}, {"id": 1, "command": "arm"}, {"token": 7}])
def test_a_client_without_the_token_is_disconnected(first: dict[str, Any]) -> None:
    assert exchange(first, {"id": 1, "command": "arm", "args": {}}, answers=2) == []


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


async def executed_of_the_gone(folder: Path, *commands: str) -> list[str]:
    """Return what is executed of a client that sends commands and is gone.

    The server sends something to it before it reads them.
    """
    executed: list[str] = []

    class Desk(OneDesk):
        def __init__(self, client: ConnectedClient) -> None:
            self.handle = keep

    async def keep(command: str, args: dict[str, Any]) -> dict[str, Any]:
        executed.append(command)
        return {}

    server = Server([].append)
    listener = open_listener(folder / "s")
    with listener, socket.socket(listener.family) as client:
        await server.open(Door(listener, TOKEN), Desk)
        client.connect(listener.getsockname())
        client.sendall(LOGIN)
        while not len(server):
            await asyncio.sleep(0)
        await asyncio.sleep(0)
        for number, command in enumerate(commands):
            client.sendall(encode_message({"id": number, "command": command, "args": {}}))
        client.close()
        server.broadcast({"event": "busy"})
        while len(server):
            await asyncio.sleep(0)
        await asyncio.sleep(0)
        await server.close()
    return executed


def test_a_stop_of_a_client_that_is_gone_before_it_is_read_is_executed(tmp_path: Path) -> None:
    """What was sent to the client failed, and asyncio forgot what the client had sent."""
    assert asyncio.run(executed_of_the_gone(tmp_path, "arm", "stop")) == ["stop"]


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
def test_a_refusal_cites_little_of_a_request(line: bytes, harness: EngineHarness) -> None:
    async def scenario(harness: EngineHarness) -> None:
        reader, writer = await asyncio.open_connection(*harness.address)
        writer.write(b'{"token":"token"}\n' + line)
        while "reply" not in (message := decode_message(await reader.readline())):
            pass
        writer.close()
        await writer.wait_closed()
        assert not message["ok"] and message["exit_code"] == 2
        assert 20 < len(message["error"]) <= 500 and "n" * 101 not in message["error"]

    harness.run(scenario)
