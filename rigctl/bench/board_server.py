"""Serve simulated cables to other programs over loopback TCP and pseudo-terminals.

Every client receives the cable's bytes from its connection on and may send its own; bytes without
a reader are dropped, as on a cable.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol

LOOPBACK = "127.0.0.1"
POLL_S = 0.05
"""Period at which the server checks whether a program has opened or closed a pseudo-terminal."""

_READ_SIZE = 4096
_MAX_BUFFERED = 1 << 20


class ServedLink(Protocol):
    """A cable with a simulated thing at its other end. All calls come from the loop's thread."""

    name: str

    def open(
        self, on_bytes: Callable[[bytes, float], None], on_lost: Callable[[str], None]
    ) -> None:
        """Start receiving: ``on_bytes(data, at_s)`` in simulated seconds."""

    def write(self, data: bytes) -> None:
        """Send bytes to the other end."""

    def close(self) -> None:
        """Stop receiving."""


@dataclass(frozen=True, slots=True)
class Addresses:
    """Addresses of one cable.

    ``tcp`` is empty where only terminals are served, ``pty`` on systems without pseudo-terminals.
    """

    tcp: str
    pty: str


class _PseudoTerminal:
    """A pseudo-terminal whose slave end is a serial port for other programs."""

    def __init__(self, link: ServedLink) -> None:
        import tty

        self._link = link
        self._master, slave = os.openpty()
        tty.setraw(slave)
        os.fchmod(slave, 0o600)  # the system lets a group of users write into it
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poller = select.poll()
        self._poller.register(self._master, 0)
        self._open = False

    def _is_open(self) -> bool:
        return not any(events & select.POLLHUP for _, events in self._poller.poll(0))

    def poll(self, loop: asyncio.AbstractEventLoop) -> None:
        """Detect that a program has opened or closed the slave end."""
        now_open = self._is_open()
        if now_open and not self._open:
            loop.add_reader(self._master, self._readable, loop)
        elif self._open and not now_open:
            loop.remove_reader(self._master)
            self._flush()
        self._open = now_open

    def write(self, data: bytes) -> None:
        """Write the cable's bytes; they are dropped while no program reads."""
        if self._open and self._is_open():
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self, loop: asyncio.AbstractEventLoop) -> None:
        """Remove the terminal."""
        loop.remove_reader(self._master)
        os.close(self._master)

    def _readable(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            data = os.read(self._master, _READ_SIZE)
        except BlockingIOError:
            return
        except OSError:  # EIO: the slave end was closed
            self.poll(loop)
            return
        self._link.write(data)

    def _flush(self) -> None:
        """Discard the bytes that the last program did not read."""
        import termios

        slave = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
        termios.tcflush(slave, termios.TCIOFLUSH)
        os.close(slave)


class _LinkServer:
    """Serves one cable to any number of programs."""

    def __init__(self, link: ServedLink) -> None:
        self._link = link
        self._clients: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None
        self._terminal = _PseudoTerminal(link) if hasattr(os, "openpty") else None

    async def start(self, terminals_only: bool) -> Addresses:
        """Open the cable, the TCP port and the terminal."""
        tcp = "" if terminals_only else await self._open_port()
        self._link.open(self._publish, lambda reason: None)
        return Addresses(tcp, self._terminal.path if self._terminal else "")

    async def _open_port(self) -> str:
        self._server = await asyncio.start_server(self._serve, LOOPBACK, 0)
        return f"{LOOPBACK}:{self._server.sockets[0].getsockname()[1]}"

    def poll(self, loop: asyncio.AbstractEventLoop) -> None:
        """Detect clients of the pseudo-terminal."""
        if self._terminal is not None:
            self._terminal.poll(loop)

    async def close(self) -> None:
        """Close the TCP port, the terminal and the cable."""
        if self._server is not None:
            self._server.close()
        for client in self._clients:
            client.close()
        if self._server is not None:
            await self._server.wait_closed()
        # Python 3.11 does not wait for the connections' own tasks here.
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._terminal is not None:
            self._terminal.close(asyncio.get_running_loop())
        self._link.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        try:
            while data := await reader.read(_READ_SIZE):
                self._link.write(data)
        except ConnectionError:
            pass  # the client has gone
        finally:
            self._clients.discard(writer)
            writer.close()

    def _publish(self, data: bytes, at_s: float) -> None:
        if self._terminal is not None:
            self._terminal.write(data)
        for client in self._clients:
            if client.transport.get_write_buffer_size() < _MAX_BUFFERED:
                client.write(data)


async def serve(
    links: Iterable[ServedLink],
    stop: asyncio.Event,
    started: asyncio.Future[dict[str, Addresses]],
    terminals_only: bool = False,
) -> None:
    """Serve cables until ``stop`` is set; resolve ``started`` to the addresses by their names.

    Every user of the computer can connect to a TCP port, this user alone to a terminal:
    ``terminals_only`` opens no ports.
    """
    servers = {link.name: _LinkServer(link) for link in links}
    started.set_result(
        {name: await server.start(terminals_only) for name, server in servers.items()}
    )
    loop = asyncio.get_running_loop()
    while not stop.is_set():
        for server in servers.values():
            server.poll(loop)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), POLL_S)
    for server in servers.values():
        await server.close()
