"""Clients that stop reading cost the engine neither memory nor time, and learn what they missed."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Any

import pytest

from rigctl.engine.rpc import client as client_module
from rigctl.engine.rpc.client import MAX_WAITING, EngineClient, EngineRefusal
from rigctl.engine.rpc.engine_files import EngineFile
from rigctl.engine.rpc.messages import DISCONNECTED_TEXT, LINE_LIMIT_BYTES, encode_message
from rigctl.engine.rpc.server import (
    MAX_UNDER_WAY,
    STOPPED_READING,
    UNREAD_LIMIT_BYTES,
    Control,
)
from rigctl.errors import LinkLost
from tests.engine.engine_harness import EngineHarness
from tests.engine.rpc.client_connection import ClientConnection


@contextmanager
def deaf_client(harness: EngineHarness, *commands: bytes) -> Iterator[socket.socket]:
    """Yield a connection that sends requests and never reads; the system keeps little for it."""
    with socket.socket(socket.AF_INET) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(harness.address)
        connection.sendall(b'{"token":"token"}\n' + b"".join(commands))
        yield connection


def request(number: int, command: str, **args: Any) -> bytes:
    return encode_message({"id": number, "command": command, "args": args})


def all_clients(harness: EngineHarness) -> list[Any]:
    return list(harness.engine._server._clients)


def test_a_run_goes_on_beside_a_client_that_never_reads(harness: EngineHarness) -> None:
    """The run commits all of its trials, and what waits is bounded."""
    most: list[int] = []

    async def scenario(harness: EngineHarness) -> None:
        with deaf_client(harness, request(1, "introduce", name="deaf")):
            while not harness.has_ended():
                await harness.wait(0.5)
                most.append(max(client.unread_bytes for client in all_clients(harness)))

    harness.run(scenario, harness.request())
    assert harness.engine.status().run.trials_committed == 4
    assert max(most) < LINE_LIMIT_BYTES


async def test_the_hopeless_is_disconnected_and_the_others_learn_it(harness: EngineHarness) -> None:
    """A thousand replies of 250 kB: what has not been read by then is too much."""
    for number in range(500):
        harness.engine.event_bus.publish("log", f"{number} " + 480 * "x")
    asks = [request(number, "history", count=500) for number in range(3, 60)]
    first = request(1, "introduce", name="deaf")
    with deaf_client(harness, first) as deaf:
        await harness.until(lambda: bool(harness.engine._server.control.state.holder))
        other = await ClientConnection.connect(harness.address, "other")
        # Only now, as the engine may answer and disconnect the deaf client between two polls.
        deaf.sendall(b"".join(asks))
        while "stopped reading" not in (told := await other.until("control"))["text"]:
            assert max(c.unread_bytes for c in all_clients(harness)) < (
                UNREAD_LIMIT_BYTES + LINE_LIMIT_BYTES
            )
        assert told["text"] == "deaf stopped reading and was disconnected; nobody has control"
        await other.request("arm")
        await harness.until(lambda: len(harness.engine._server) == 1)
        await other.close()


async def test_too_many_requests_at_once_are_refused_and_stop_is_not(
    harness: EngineHarness, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(harness.engine.boards.taxels, "test", lambda: asyncio.sleep(5))
    client = await ClientConnection.connect(harness.address, "many")
    for number in range(1000, 1000 + MAX_UNDER_WAY):
        client._writer.write(request(number, "test_taxels"))
    assert f"{MAX_UNDER_WAY} requests are under way" in await client.refusal("status")
    await client.request("stop")
    await harness.wait(6.0)
    await client.request("status")
    await client.close()


async def test_the_65th_client_is_sent_away(harness: EngineHarness) -> None:
    clients = [await ClientConnection.connect(harness.address, f"c{n}") for n in range(64)]
    reader, writer = await asyncio.open_connection(*harness.address)
    writer.write(b'{"token":"token"}\n')
    assert await reader.read() == b""
    writer.close()
    await writer.wait_closed()
    for client in clients:
        await client.close()


def test_a_client_that_is_busy_keeps_the_newest_status_and_counts_lost_events(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(client_module, "KEPT_MESSAGES", 10)
    with hung_engine() as (client, _):
        for number in range(1000):
            client._keep({"event": "status", "data": number})
        client._keep({"event": "log", "text": "then"})
        newest = {"event": "status", "data": 999}
        assert client.drain() == [newest, {"event": "log", "text": "then"}]
        for number in range(25):
            client._keep({"event": "log", "text": str(number)})
        first, *rest = client.drain()
        assert first["event"] == "left_out" and first["data"] == {"messages": 15}
        assert [message["text"] for message in rest] == [str(number) for number in range(15, 25)]
        assert client.drain() == []


def test_a_client_that_was_disconnected_knows_the_reason() -> None:
    with hung_engine() as (client, engine):
        message = {"event": "disconnected", "text": DISCONNECTED_TEXT, "data": {}}
        engine.sendall(encode_message(message))
        engine.close()
        with pytest.raises(LinkLost, match="has disconnected this client"):
            while True:
                client.wait(5.0)
        assert client.shut_down() is None


def test_control_tells_why_a_client_is_gone() -> None:
    told: list[str] = []
    control = Control(told.append)
    control.join(1, "A")
    control.join(2, "B")
    control.leave(2, STOPPED_READING)
    assert told[-1] == "B stopped reading and was disconnected"
    control.leave(2)
    assert len(told) == 3


@contextmanager
def hung_engine() -> Iterator[tuple[EngineClient, socket.socket]]:
    """Yield a client and the engine's end of its connection, which nobody reads."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        file = EngineFile("e", 1, port, "t", "virtual", "")
        with closing(EngineClient(file)) as client:
            engine, _ = listener.accept()
            with engine:
                yield client, engine


def flood(client: EngineClient) -> int:
    """Send long requests until the client takes no more; return the number of the last."""
    number = 0
    with pytest.raises(EngineRefusal, match="has not read the requests before"):
        while True:
            number = client.send("note", text="x" * 60_000)
    return number


def test_an_engine_that_hangs_holds_nobody_who_sends() -> None:
    with hung_engine() as (client, engine):
        last = flood(client)
        assert client.is_behind and last > MAX_WAITING
        stop = client.send("stop")
        refused = client.drain()
        assert all("STOP came before" in message["error"] for message in refused)
        numbers = [message["reply"] for message in refused]
        assert numbers == list(range(numbers[0], stop)) and len(numbers) >= MAX_WAITING - 1
        with engine.makefile("rb") as file:
            sent: list[int] = []
            assert b"token" in file.readline()
            while stop not in sent:
                client.drain()
                sent.append(int(file.readline().split(b",")[0].split(b":")[1]))
        assert sent == [*range(1, numbers[0]), stop]
        assert not client.is_behind


def test_an_engine_that_ends_while_requests_wait_is_lost() -> None:
    with hung_engine() as (client, engine):
        flood(client)
        engine.close()
        with pytest.raises(LinkLost, match="the engine ended"):
            while True:
                client.wait(5.0)
