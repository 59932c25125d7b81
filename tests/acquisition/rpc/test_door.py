"""Strangers at the engine's door: they are served side by side and delay nobody."""

from __future__ import annotations

import asyncio
import os
import socket
import stat
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from rigctl.acquisition.rpc import door as door_module
from rigctl.acquisition.rpc.client import EngineClient
from rigctl.acquisition.rpc.door import (
    LOGIN_LIMIT_BYTES,
    MAX_STRANGERS,
    Door,
    LoggedIn,
    open_listener,
)
from rigctl.acquisition.rpc.engine_files import EngineFile
from rigctl.acquisition.rpc.messages import encode_message

TOKEN = "a secret"
LOGIN = encode_message({"token": TOKEN})
HOSTILE = [
    '{"token":"é"}\n'.encode(),
    b"[" * 100_000,
    b"[" * (LOGIN_LIMIT_BYTES - 1) + b"\n",
    b'{"token":' * 50 + b"\n",
    b'{"token":"\\ud800"}\n',
    b'{"token":NaN}\n',
    b'{"token":null}\n',
    b'{"token":"' + b"a" * LOGIN_LIMIT_BYTES + b'"}\n',
    b"\xff\xfe\n",
    b"\n",
    b"x" * 10_000_000,
    b"GET / HTTP/1.1\r\n\r\n",
    LOGIN[:-1],
]


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[socket.socket]:
    with open_listener(tmp_path / "s") as opened:
        yield opened


def come(listener: socket.socket, *sent: bytes) -> socket.socket:
    """Return a connection that has sent this, or as much as is taken."""
    connection = socket.socket(listener.family)
    connection.connect(listener.getsockname())
    connection.setblocking(False)
    for data in sent:
        try:
            connection.sendall(data)
        except BlockingIOError:
            break
    return connection


def let_in(door: Door) -> list[bytes]:
    """Return what came behind the token of each client that the door lets in."""
    clients: list[LoggedIn] = list(door.take_clients())

    async def serve() -> None:
        door.open(asyncio.get_running_loop(), clients.append)
        for _ in range(200):
            await asyncio.sleep(0)
        door.pause()

    asyncio.run(serve())
    for client in clients:
        client.connection.close()
    return [client.rest for client in clients]


def is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


@pytest.mark.parametrize("sent", HOSTILE, ids=lambda sent: repr(sent[:30]))
def test_a_hostile_stranger_ends_and_delays_nothing(listener: socket.socket, sent: bytes) -> None:
    door = Door(listener, TOKEN)
    with come(listener, sent), come(listener, LOGIN + b"more"):
        assert door.wait_first_client()
        assert let_in(door) == [b"more"]
    door.close()


def test_silent_strangers_do_not_keep_the_first_client_out(listener: socket.socket) -> None:
    door = Door(listener, TOKEN)
    with ExitStack() as stack:
        for _ in range(5):
            stack.enter_context(come(listener))
        stack.enter_context(come(listener, LOGIN))
        assert door.wait_first_client()
        assert let_in(door) == [b""]
        door.close()


def test_without_a_client_the_wait_ends(listener: socket.socket) -> None:
    door = Door(listener, TOKEN)
    with come(listener):
        assert not door.wait_first_client(timeout_s=0.05)
        door.close()


def test_a_stranger_who_waited_is_let_in_later(listener: socket.socket) -> None:
    door = Door(listener, TOKEN)
    with come(listener, LOGIN[:5]) as slow, come(listener, LOGIN) as first:
        assert door.wait_first_client()
        slow.sendall(LOGIN[5:])
        assert let_in(door) == [b"", b""]
        door.close()
        assert is_closed(first)


def test_of_too_many_strangers_the_one_silent_longest_is_dropped(listener: socket.socket) -> None:
    door = Door(listener, TOKEN)
    with ExitStack() as stack:
        strangers = []
        for _ in range(MAX_STRANGERS + 3):
            strangers.append(stack.enter_context(come(listener)))
            assert let_in(door) == []
        assert [is_closed(stranger) for stranger in strangers[:4]] == [True, True, True, False]
        strangers[-1].sendall(LOGIN)
        assert let_in(door) == [b""]
        door.close()
        assert all(is_closed(stranger) for stranger in strangers)


def test_a_door_sets_no_timer(listener: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
    timers: list[float] = []

    async def serve() -> None:
        loop = asyncio.get_running_loop()
        monkeypatch.setattr(loop, "call_at", lambda when, *_, **__: timers.append(when))
        door = Door(listener, TOKEN)
        admitted: list[LoggedIn] = []
        door.open(loop, admitted.append)
        with come(listener), come(listener, LOGIN):
            while not admitted:
                await asyncio.sleep(0)
            door.close()
        admitted[0].connection.close()

    asyncio.run(serve())
    assert timers == []


def test_the_kernel_refuses_another_user(
    listener: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(door_module, "_is_foreign", lambda connection: True)
    door = Door(listener, TOKEN)
    with come(listener, LOGIN) as foreign:
        assert let_in(door) == []
        assert is_closed(foreign)
    door.close()


def test_another_user_is_told_by_the_kernel(
    listener: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    door = Door(listener, TOKEN)
    with come(listener, LOGIN) as foreign:
        assert let_in(door) == []
        assert is_closed(foreign)
    door.close()


def test_the_socket_is_the_users_alone(tmp_path: Path) -> None:
    with open_listener(tmp_path / "s") as listener:
        assert listener.getsockname() == str(tmp_path / "s")
        assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o600


def test_a_path_too_long_for_a_socket_gives_a_port(tmp_path: Path) -> None:
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    with open_listener(folder / "s") as listener:
        assert listener.getsockname()[0] == "127.0.0.1"
    assert list(folder.iterdir()) == []


def test_a_client_waits_where_others_are_in_the_queue(
    listener: socket.socket, tmp_path: Path
) -> None:
    """Its connection was refused at once when the queue of the socket was full."""
    path = listener.getsockname()
    engine = EngineFile("one", os.getpid(), 0, TOKEN, "virtual", "", socket=path)
    with ExitStack() as stack:
        while True:
            other = stack.enter_context(socket.socket(socket.AF_UNIX))
            other.setblocking(False)
            try:
                other.connect(path)
            except BlockingIOError:
                break
        clients: list[EngineClient] = []
        thread = threading.Thread(target=lambda: clients.append(EngineClient(engine)))
        thread.start()
        door = Door(listener, TOKEN)
        assert door.wait_first_client()
        thread.join()
        clients[0].close()
        door.close()
