"""A board behind a loopback socket."""

from __future__ import annotations

import asyncio

import pytest

from rigctl.boards.links import TcpLink
from rigctl.errors import ConfigError, LinkLost


async def test_bytes_go_both_ways_and_a_close_by_the_other_end_is_reported() -> None:
    loop = asyncio.get_running_loop()
    heard: asyncio.Queue[bytes | str] = asyncio.Queue()
    clients: list[asyncio.StreamWriter] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        clients.append(writer)
        writer.write(b"echo " + await reader.read(100))

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    link = TcpLink(f"tcp://127.0.0.1:{port}", loop)
    link.open(lambda data, at_s: heard.put_nowait(data), heard.put_nowait)
    link.write(b"hello")
    assert await heard.get() == b"echo hello"
    clients[0].close()
    assert "the other end closed" in str(await heard.get())
    assert not link.is_open
    with pytest.raises(LinkLost, match="the connection is closed"):
        link.write(b"x")
    server.close()
    await server.wait_closed()
    with pytest.raises(LinkLost, match="no server listens there: start rigctl serve"):
        link.open(lambda data, at_s: None, heard.put_nowait)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1", "tcp://:x", "udp://1.2.3.4:5"])
def test_an_invalid_address_is_refused_with_the_format(address: str) -> None:
    loop = asyncio.new_event_loop()
    with pytest.raises(ConfigError, match="write an address as tcp://"):
        TcpLink(address, loop)
    loop.close()
