"""The engine's server: token check, replies, errors."""

from __future__ import annotations

import asyncio
import socket
import threading
from typing import Any

import pytest

from rigctl.acquisition.rpc.messages import decode_message, encode_message
from rigctl.acquisition.rpc.server import (
    EngineAddress,
    Server,
    accept_first_client,
    open_listener,
)
from rigctl.errors import BoardFault, WrongUse

TOKEN = "a secret"


async def handle(command: str, args: dict[str, Any]) -> dict[str, Any]:
    if command == "fail":
        raise BoardFault("the board said no: ask it kindly")
    if command == "crash":
        raise ZeroDivisionError
    return {"command": command, **args}


async def talk(*lines: bytes, answers: int) -> list[dict[str, Any]]:
    """Return the messages that a client gets for these lines; fewer where it is disconnected."""
    server = Server()
    listener = open_listener()
    port = listener.getsockname()[1]
    await server.open(EngineAddress(listener, TOKEN), handle)
    server.set_greeting({"event": "ready"})
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.writelines(lines)
    received = []
    while len(received) < answers and (line := await reader.readline()):
        received.append(decode_message(line))
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
        {"id": 3, "command": "crash"},
        answers=4,
    )
    assert received[0] == {"event": "ready"}
    assert received[1] == {"reply": 1, "ok": True, "result": {"command": "arm", "gently": 1}}
    assert received[2]["error"] == "the board said no: ask it kindly"
    assert (received[2]["ok"], received[2]["exit_code"]) == (False, 3)
    assert "ZeroDivisionError" in received[3]["error"]


@pytest.mark.parametrize("first", [{"token": "wrong"}, {"id": 1, "command": "arm"}, {"token": 7}])
def test_a_client_without_the_token_is_disconnected(first: dict[str, Any]) -> None:
    assert exchange(first, {"id": 1, "command": "arm", "args": {}}, answers=2) == []


def test_an_invalid_line_closes_the_connection() -> None:
    lines = (encode_message({"token": TOKEN}), b"[1, 2]\n")
    assert asyncio.run(talk(*lines, answers=9)) == [{"event": "ready"}]


def test_args_must_be_an_object() -> None:
    received = exchange({"token": TOKEN}, {"id": 1, "command": "arm", "args": [1]}, answers=2)
    assert received[1]["exit_code"] == WrongUse.exit_code


@pytest.mark.parametrize(("token", "let_in"), [(TOKEN, True), ("wrong", False)])
def test_the_first_client_is_accepted_before_the_loop_runs(token: str, let_in: bool) -> None:
    with open_listener() as listener:
        port = listener.getsockname()[1]

        def come() -> None:
            with socket.create_connection(("127.0.0.1", port)) as connection:
                connection.sendall(encode_message({"token": token}))
                connection.recv(1)

        client = threading.Thread(target=come)
        client.start()
        first = accept_first_client(listener, TOKEN)
        assert (first is not None) is let_in
        if first is not None:
            first.close()
        client.join()


def test_accepting_the_first_client_times_out() -> None:
    with open_listener() as listener:
        assert accept_first_client(listener, TOKEN, timeout_s=0.05) is None
