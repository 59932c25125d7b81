"""A serial port on a pseudo-terminal: bytes both ways, one owner, and a reported loss."""

from __future__ import annotations

import asyncio
import os
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from rigctl.boards.bench_loop import BenchLoop
from rigctl.boards.links import SerialLink, TcpLink
from rigctl.errors import ConfigError, LinkLost


@dataclass
class Terminal:
    """Both ends of a pseudo-terminal; the board holds ``master``."""

    master: int
    slave: int
    path: str
    open_ends: list[int] = field(default_factory=list)

    def close_board(self) -> None:
        for end in self.open_ends:
            os.close(end)
        self.open_ends = []


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    master, slave = os.openpty()
    tty.setraw(slave)
    ends = Terminal(master, slave, os.ttyname(slave), [master, slave])
    yield ends
    ends.close_board()


class LinkRecorder:
    """Records bytes and loss of a link, and waits for them."""

    def __init__(self) -> None:
        self.data = b""
        self.lost: list[str] = []
        self.changed = asyncio.Event()

    def on_bytes(self, data: bytes, at_s: float) -> None:
        self.data += data
        self.changed.set()

    def on_lost(self, reason: str) -> None:
        self.lost.append(reason)
        self.changed.set()

    async def until(self, done: Callable[[], object]) -> None:
        while not done():
            self.changed.clear()
            await asyncio.wait_for(self.changed.wait(), 60)


@pytest.mark.parametrize("batch_s", [0.0, 0.01])
async def test_bytes_go_both_ways(terminal: Terminal, batch_s: float) -> None:
    link = SerialLink(terminal.path, 115200, asyncio.get_running_loop(), batch_s)
    ear = LinkRecorder()
    link.open(ear.on_bytes, ear.on_lost)
    assert link.is_open
    sent = bytes(range(256)) * 8
    os.write(terminal.master, sent)
    await ear.until(lambda: len(ear.data) >= len(sent))
    assert ear.data == sent
    link.write(b"\x00\x03who")
    assert os.read(terminal.master, 100) == b"\x00\x03who"
    link.close()
    link.close()
    assert not link.is_open
    with pytest.raises(LinkLost, match="the port is closed"):
        link.write(b"x")


async def test_a_second_owner_is_refused_and_the_port_is_free_after_a_close(
    terminal: Terminal,
) -> None:
    loop = asyncio.get_running_loop()
    first, second = (SerialLink(terminal.path, 115200, loop) for _ in range(2))
    ear = LinkRecorder()
    first.open(ear.on_bytes, ear.on_lost)
    with pytest.raises(LinkLost, match="the port is in use: close the program that holds it"):
        second.open(ear.on_bytes, ear.on_lost)
    first.close()
    second.open(ear.on_bytes, ear.on_lost)
    second.close()


async def test_the_line_that_resets_the_board_stays_up_after_a_close(terminal: Terminal) -> None:
    settings = termios.tcgetattr(terminal.slave)
    settings[2] |= termios.HUPCL
    termios.tcsetattr(terminal.slave, termios.TCSANOW, settings)
    link = SerialLink(terminal.path, 115200, asyncio.get_running_loop())
    ear = LinkRecorder()
    link.open(ear.on_bytes, ear.on_lost)
    link.retune(500_000, 0.01)
    assert termios.tcgetattr(terminal.slave)[4] == termios.B500000
    link.close()
    assert not termios.tcgetattr(terminal.slave)[2] & termios.HUPCL


async def test_a_port_that_vanishes_is_reported_once(terminal: Terminal) -> None:
    link = SerialLink(terminal.path, 115200, asyncio.get_running_loop())
    ear = LinkRecorder()
    link.open(ear.on_bytes, ear.on_lost)
    terminal.close_board()
    await ear.until(lambda: ear.lost)
    assert len(ear.lost) == 1
    assert "the port vanished, plug the board in again" in ear.lost[0]
    assert not link.is_open
    with pytest.raises(LinkLost):
        link.write(b"x")


async def test_a_missing_port_and_a_file_that_is_no_port_are_one_sentence_each(
    tmp_path: Path,
) -> None:
    loop = asyncio.get_running_loop()
    ear = LinkRecorder()
    missing = SerialLink(str(tmp_path / "ttyUSB9"), 115200, loop)
    with pytest.raises(LinkLost, match="ttyUSB9: there is no such port: plug the board in"):
        missing.open(ear.on_bytes, ear.on_lost)
    plain = tmp_path / "notes.txt"
    plain.write_text("hello")
    with pytest.raises(LinkLost, match=r"notes\.txt: the port cannot be opened"):
        SerialLink(str(plain), 115200, loop).open(ear.on_bytes, ear.on_lost)


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


class Ports:
    """What the system lists: names of USB devices that may change."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._listed: list[ListPortInfo] = []
        monkeypatch.setattr(list_ports, "comports", lambda: list(self._listed))

    def list(self, *devices: tuple[str, str | None, str]) -> None:
        """List the ports with these names, serial numbers and sockets."""
        self._listed = []
        for name, serial_number, location in devices:
            info = ListPortInfo(name)
            info.vid, info.pid = 0x2341, 0x0042
            info.serial_number, info.location = serial_number, location
            self._listed.append(info)


@pytest.mark.parametrize("serial_number", ["75833", None])
async def test_a_board_that_comes_back_under_another_name_is_found(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch, serial_number: str | None
) -> None:
    ports = Ports(monkeypatch)
    ports.list((terminal.path, serial_number, "1-1"), ("other", "another", "1-2"))
    link = SerialLink(terminal.path, 115200, asyncio.get_running_loop())
    ear = LinkRecorder()
    link.open(ear.on_bytes, ear.on_lost)
    link.close()
    master, slave = os.openpty()
    tty.setraw(slave)
    renamed = os.ttyname(slave)
    # The old name is now that of the other board.
    ports.list((terminal.path, "another", "1-2"), (renamed, serial_number, "1-1"))
    link.open(ear.on_bytes, ear.on_lost)
    os.write(master, b"here")
    await ear.until(lambda: ear.data == b"here")
    assert link.name == renamed
    link.close()
    os.close(master)
    os.close(slave)


async def test_a_port_whose_device_is_gone_is_asked_for_by_its_name(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    ports = Ports(monkeypatch)
    ports.list((terminal.path, "75833", "1-1"))
    link = SerialLink(terminal.path, 115200, asyncio.get_running_loop())
    ear = LinkRecorder()
    link.open(ear.on_bytes, ear.on_lost)
    link.close()
    ports.list(("other", "another", "1-2"))
    link.open(ear.on_bytes, ear.on_lost)
    assert link.name == terminal.path
    link.close()


@pytest.mark.skipif(sys.platform != "linux", reason="the name of the clock is Linux's")
def test_the_clock_of_a_bench_counts_the_sleep_of_the_computer() -> None:
    loop = BenchLoop()
    try:
        before_s = time.clock_gettime(time.CLOCK_BOOTTIME)
        assert before_s <= loop.time() <= time.clock_gettime(time.CLOCK_BOOTTIME)
    finally:
        loop.close()
