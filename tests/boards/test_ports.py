"""Boards on pseudo-terminals are identified, and swapped ports are named."""

from __future__ import annotations

import asyncio
import json
import os
import re
import threading
import tty
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rigctl.boards import boot_silence, taxel_decoder
from rigctl.boards import drum as drum_module
from rigctl.boards import taxels as taxels_module
from rigctl.boards.port_discovery import find_boards, probe_ports
from rigctl.cli import create_parser
from rigctl.cli import ports as ports_command
from rigctl.errors import ConfigError, LinkLost, WrongBoard, WrongUse
from rigctl.finger import driver as finger_module
from rigctl.rig import open_rig
from tests.boards import taxel_encoder
from tests.boards.memory_link import RegisterBoard
from tests.boards.test_flash import usb_port
from tests.boards.test_taxels import StreamingBoard
from tests.finger.board import FirmwareBoard


def ports_cli(argv: list[str]) -> int:
    return ports_command.run(create_parser(["ports"]).parse_args(argv))


class TerminalLink:
    """The board's end of a pseudo-terminal, served by a loop in a thread of its own."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)
        self.board = lambda data: None
        self._loop = loop

    def start(self) -> None:
        self._loop.add_reader(self.master, lambda: self.board(os.read(self.master, 1000)))

    def say(self, data: bytes, after_s: float = 0.0) -> None:
        self._loop.call_later(after_s, self._write, data)

    def _write(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # nobody reads: the bytes are lost, as on a cable
            os.write(self.master, data)

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)


def warm_kernels() -> None:
    """Compile before the clock runs."""
    empty = np.zeros(0, np.uint8)
    taxel_encoder.encode_data(np.zeros(0, np.int64), np.zeros((0, 18), np.uint16), empty, empty)
    taxel_decoder.FrameDecoder(18)


class Terminals:
    """Four pseudo-terminals: a drum, a taxel board, a finger board, and one without a board."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        warm_kernels()
        links = [TerminalLink(self.loop) for _ in range(4)]
        self.drum, self.taxels, self.finger, self.nobody = links
        RegisterBoard(self.loop, self.drum)  # type: ignore[arg-type]
        self.loop.call_soon(StreamingBoard, self.loop, self.taxels)
        self.loop.call_soon(FirmwareBoard, self.loop, self.finger)
        for link in (self.drum, self.taxels, self.finger):
            self.loop.call_soon(link.start)
        self.thread = threading.Thread(target=self.loop.run_forever)
        self.thread.start()

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join()
        self.loop.close()
        for link in (self.drum, self.taxels, self.finger, self.nobody):
            link.close()


@pytest.fixture
def terminals(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminals]:
    for module in (drum_module, taxels_module, finger_module):
        monkeypatch.setattr(module, "CONNECT_TIMEOUT_S", 3.0)
    monkeypatch.setattr(boot_silence, "AFTER_OPEN_S", 0.3)
    monkeypatch.setattr(boot_silence, "ASK_S", 3.0)  # on a busy computer
    monkeypatch.setattr(finger_module, "ANSWER_TIMEOUT_S", 3.0)
    there = Terminals()
    yield there
    there.close()


def test_every_port_is_identified(
    terminals: Terminals, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    paths = [terminals.drum.path, terminals.taxels.path, terminals.nobody.path]
    assert ports_cli(["ports", "--json", *paths, str(tmp_path / "none")]) == 0
    drum, taxels, nobody, none = json.loads(capsys.readouterr().out)
    assert (drum["port"], drum["board"], drum["firmware"]) == (paths[0], "drum", "1.3")
    assert drum["counters"]["late_ticks"] == 0
    assert (taxels["port"], taxels["board"], taxels["boot_count"]) == (paths[1], "taxels", 7)
    assert taxels["counters"].keys() == drum["counters"].keys() - {
        "loadcell_dropped",
        "settings_from",
    }
    assert (nobody["board"], nobody["text"]) == (None, "no rigctl board answered")
    assert none["text"].startswith("there is no such port")
    assert ports_cli(["ports", paths[0]]) == 0
    assert capsys.readouterr().out == (
        f"{paths[0]}: drum board, firmware 1.3, build 00c0ffee, boot 41 by power-up\n"
        "  0 late ticks, longest interrupt 0 µs, 0 bytes of stack never used, idle 0 %, "
        "settings defaults\n"
    )
    assert ports_cli(["ports", paths[1]]) == 0
    assert capsys.readouterr().out == (
        f"{paths[1]}: taxels board, firmware 1.2, build deadbeef, boot 7 by its reset pin, "
        "supply 5.01 V\n"
        "  0 late ticks, longest interrupt 20 µs, 900 bytes of stack never used, idle 48 %\n"
        "  line D5 stays low: it is connected to ground; free it\n"
    )


def test_a_finger_board_is_identified(
    terminals: Terminals, capsys: pytest.CaptureFixture[str]
) -> None:
    path = terminals.finger.path
    assert ports_cli(["ports", "--json", path]) == 0
    (finger,) = json.loads(capsys.readouterr().out)
    assert (finger["port"], finger["board"], finger["boot_count"]) == (path, "finger", 0)
    assert (finger["reset"], finger["counters"]) == (None, {})
    assert ports_cli(["ports", path]) == 0
    line = rf"{path}: finger board, firmware \d+\.\d+, build [0-9a-f]{{8}}\n"
    assert re.fullmatch(line, capsys.readouterr().out)


def test_the_driver_whose_board_it_is_says_what_is_wrong(
    terminals: Terminals, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.boards.identity.WIRE_VERSION", 99)
    assert ports_cli(["ports", terminals.taxels.path]) == 0
    assert "the taxel board's firmware 1.2 speaks wire version" in capsys.readouterr().out


def test_swapped_ports_are_named(terminals: Terminals, tmp_path: Path) -> None:
    description = tmp_path / "rig.toml"
    ports = f'drum = "{terminals.taxels.path}"\ntaxels = "{terminals.drum.path}"\n'
    description.write_text(f"[ports]\n{ports}")
    rig = open_rig(str(description))
    assert (rig.kind, rig.simulated, rig.faults) == ("bench", False, None)
    assert not rig.set_plate("A")
    try:
        with pytest.raises(WrongBoard, match="the taxels board answers there: swap the ports in"):
            rig.loop.run_until_complete(rig.drum.connect())
        with pytest.raises(WrongBoard, match="the drum board answers there: swap the ports in"):
            rig.loop.run_until_complete(rig.taxels.connect())
    finally:
        rig.close()


def test_a_described_rig_connects_and_polls(terminals: Terminals, tmp_path: Path) -> None:
    description = tmp_path / "rig.toml"
    ports = f'drum = "{terminals.drum.path}"\ntaxels = "{terminals.taxels.path}"\n'
    description.write_text(f"[ports]\n{ports}")
    rig = open_rig(str(description))
    try:
        assert rig.loop.run_until_complete(rig.drum.connect()).board == "drum"
        assert rig.loop.run_until_complete(rig.taxels.connect()).board == "taxels"
        assert rig.loop.run_until_complete(rig.drum.poll()).values["heartbeat_seen"] == 1
        assert rig.drum.connected
        assert rig.taxels.connected
    finally:
        rig.close()
    assert not rig.drum.connected
    assert not rig.taxels.connected


def test_boards_without_a_named_port_are_searched(
    terminals: Terminals, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def found() -> dict[str, str]:
        return await find_boards(asyncio.get_running_loop())

    there = [
        usb_port(link.path, vid=None, description="pty")
        for link in (terminals.taxels, terminals.finger, terminals.drum)
    ]
    monkeypatch.setattr("rigctl.boards.port_discovery.list_ports.comports", lambda: there)
    assert asyncio.run(found()) == {
        "drum": terminals.drum.path,
        "taxels": terminals.taxels.path,
        "finger": terminals.finger.path,
    }


def test_no_port_and_no_such_rig_are_one_sentence_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigctl.boards.port_discovery.list_ports.comports", list)
    empty = tmp_path / "rig.toml"
    empty.write_text("")
    with pytest.raises(LinkLost, match="no port answered as the drum board: plug it in"):
        open_rig(str(empty))
    with pytest.raises(WrongUse, match="there is no rig vitrual: give virtual, firmware, or"):
        open_rig("vitrual")
    empty.write_text('[ports]\nsimulate = "virtual"\n[taxels]\ncount = 9\n')
    with pytest.raises(ConfigError, match=r"compiled for 3 lines × 6 inputs, but .* count = 9"):
        open_rig(str(empty))
    empty.write_text('[ports]\nsimulate = "firmware"\n[taxels]\ncount = 9\n')
    with pytest.raises(ConfigError, match="simulated chips have three lines × six inputs: set"):
        open_rig(str(empty))
    assert asyncio.run(_none()) == []


async def _none() -> list[object]:
    return list(await probe_ports(asyncio.get_running_loop()))
