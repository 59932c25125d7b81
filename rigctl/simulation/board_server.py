"""The simulated boards for outside programs: loopback TCP and pseudo-terminals, in real time.

Whoever connects hears what the board says from then on and may talk to it; bytes that nobody
takes are dropped, as on a cable.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
from dataclasses import dataclass

from rigctl.simulation.simulated_rig import SimulatedLink, SimulatedRig

LOOPBACK = "127.0.0.1"
LOOK_S = 0.05
"""How often a pseudo-terminal is looked at while no program has it open."""

_READ_SIZE = 4096
_MOST_BUFFERED = 1 << 20


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where one board can be reached; ``pty`` is empty where the system has none."""

    tcp: str
    pty: str


class _Terminal:
    """A pseudo-terminal whose far end looks like a serial port to other programs."""

    def __init__(self, link: SimulatedLink) -> None:
        import tty

        self._link = link
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, 0)
        self._open = False

    def _is_open(self) -> bool:
        return not any(events & select.POLLHUP for _, events in self._poll.poll(0))

    def look(self, loop: asyncio.AbstractEventLoop) -> None:
        """Notice a program that opened or closed the far end."""
        now_open = self._is_open()
        if now_open and not self._open:
            loop.add_reader(self._master, self._readable, loop)
        elif self._open and not now_open:
            loop.remove_reader(self._master)
            self._forget()
        self._open = now_open

    def write(self, data: bytes) -> None:
        """What the board says; dropped where nobody reads."""
        if self._open and self._is_open():
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, data)

    def close(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the terminal away."""
        loop.remove_reader(self._master)
        os.close(self._master)

    def _readable(self, loop: asyncio.AbstractEventLoop) -> None:
        try:
            data = os.read(self._master, _READ_SIZE)
        except BlockingIOError:
            return
        except OSError:  # EIO: the far end was closed
            self.look(loop)
            return
        self._link.write(data)

    def _forget(self) -> None:
        """Throw away what the last program did not read."""
        import termios

        slave = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
        termios.tcflush(slave, termios.TCIOFLUSH)
        os.close(slave)


class _Offer:
    """One board, offered to any number of programs."""

    def __init__(self, link: SimulatedLink) -> None:
        self._link = link
        self._clients: set[asyncio.StreamWriter] = set()
        self._serving: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None
        self._terminal = _Terminal(link) if hasattr(os, "openpty") else None

    async def start(self) -> Addresses:
        """Open the board's cable and both doors to it."""
        self._server = await asyncio.start_server(self._serve, LOOPBACK, 0)
        port = self._server.sockets[0].getsockname()[1]
        self._link.open(self._said, lambda reason: None)
        return Addresses(f"{LOOPBACK}:{port}", self._terminal.path if self._terminal else "")

    def look(self, loop: asyncio.AbstractEventLoop) -> None:
        """Notice who came and went on the pseudo-terminal."""
        if self._terminal is not None:
            self._terminal.look(loop)

    async def close(self) -> None:
        """Close both doors, then the cable."""
        assert self._server is not None
        self._server.close()
        for client in self._clients:
            client.close()
        await self._server.wait_closed()
        # Python 3.11 does not wait for the connections' own tasks here.
        await asyncio.gather(*self._serving, return_exceptions=True)
        if self._terminal is not None:
            self._terminal.close(asyncio.get_running_loop())
        self._link.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        task = asyncio.current_task()
        assert task is not None
        self._serving.add(task)
        task.add_done_callback(self._serving.discard)
        try:
            while data := await reader.read(_READ_SIZE):
                self._link.write(data)
        except ConnectionError:
            pass  # a program that dies is a program that left
        finally:
            self._clients.discard(writer)
            writer.close()

    def _said(self, data: bytes, at_s: float) -> None:
        if self._terminal is not None:
            self._terminal.write(data)
        for client in self._clients:
            if client.transport.get_write_buffer_size() < _MOST_BUFFERED:
                client.write(data)


async def serve(
    simulation: SimulatedRig, stop: asyncio.Event, started: asyncio.Future[dict[str, Addresses]]
) -> None:
    """Offer both boards until ``stop`` is set; ``started`` gets the addresses by board name."""
    offers = {link.name: _Offer(link) for link in (simulation.drum, simulation.taxels)}
    started.set_result({name: await offer.start() for name, offer in offers.items()})
    loop = asyncio.get_running_loop()
    while not stop.is_set():
        for offer in offers.values():
            offer.look(loop)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), LOOK_S)
    for offer in offers.values():
        await offer.close()
