"""Other programs on the simulated boards: pyserial, pymodbus and Debian's mbpoll."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from pymodbus import FramerType
from pymodbus.client import AsyncModbusTcpClient, ModbusSerialClient

from rigctl.boards.drum_registers import BY_NAME, MAGIC
from rigctl.boards.taxel_decoder import FrameDecoder
from rigctl.cli import main

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are of POSIX")
DEADLINE_S = 60


@pytest.fixture(scope="module")
def boards() -> Iterator[dict[str, dict[str, str]]]:
    """Addresses of a virtual rig served by the command line; it ends well on SIGTERM."""
    command = [sys.executable, "-m", "rigctl", "serve", "--rig", "virtual", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.send_signal(signal.SIGTERM)
        assert process.wait(DEADLINE_S) == 0


Boards = dict[str, dict[str, str]]


def test_terminals_alone_are_private_and_no_port_is_open() -> None:
    command = [sys.executable, "-m", "rigctl", "serve", "--pty-only"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        shown = [process.stdout.readline() for _ in range(2)]
        listening = open_sockets(process.pid)
        process.send_signal(signal.SIGTERM)
        assert "any user" not in process.stderr.read()
    assert [line.split()[0] for line in shown] == ["drum:", "taxels:"]
    assert "tcp" not in "".join(shown)
    assert listening == 0


def open_sockets(pid: int) -> int:
    """Return how many sockets a process listens on, by the kernel's list (state 0A)."""
    listening = {
        fields[9]
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
        if (fields := line.split())[3] == "0A"
    }
    links = [str(entry.readlink()) for entry in Path(f"/proc/{pid}/fd").iterdir()]
    return len({link[8:-1] for link in links if link.startswith("socket:[")} & listening)


def test_terminals_alone_do_not_fit_a_port(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["serve", "--pty-only", "--finger", "--udp", "5040"]) == 2
    assert "offers no ports: leave --udp out" in capsys.readouterr().err


def test_the_addresses_are_loopback_and_terminals(boards: Boards) -> None:
    assert set(boards) == {"drum", "taxels"}
    for board in boards.values():
        assert board["tcp"].startswith("127.0.0.1:")
        assert Path(board["pty"]).stat().st_mode & 0o777 == 0o600


def test_mbpoll_reads_the_identity(boards: Boards) -> None:
    options = [
        "-m",
        "rtu",
        "-a",
        "1",
        "-b",
        "115200",
        "-P",
        "none",
        "-t",
        "4:hex",
        "-r",
        "1",
        "-c",
        "12",
        "-1",
    ]
    for _ in range(2):
        output = subprocess.run(
            ["mbpoll", *options, boards["drum"]["pty"]],
            capture_output=True,
            text=True,
            timeout=DEADLINE_S,
            check=True,
        )
        assert "[1]: \t0x5247" in output.stdout


def test_pymodbus_reads_over_the_terminal(boards: Boards) -> None:
    client: Any = ModbusSerialClient(boards["drum"]["pty"], baudrate=115200, timeout=DEADLINE_S)
    assert client.connect()
    assert client.read_holding_registers(0, count=1, device_id=1).registers == [MAGIC]
    client.close()


def test_wirings_are_served_and_an_unknown_one_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = [sys.executable, "-m", "rigctl", "serve", "--json", "--pty-only"]
    command += ["--wire", "potentiometer reversed", "--wire", "upper end switch unplugged"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        port = json.loads(process.stdout.readline())["drum"]["pty"]
        client: Any = ModbusSerialClient(port, baudrate=115200, timeout=DEADLINE_S)
        assert client.connect()
        entry = BY_NAME["actuator_position_um"]
        (position_um,) = client.read_holding_registers(entry.address, device_id=1).registers
        client.close()
        process.send_signal(signal.SIGTERM)
    assert position_um == pytest.approx(45_000, abs=150)
    assert main(["serve", "--wire", "potentiometer reverse"]) == 2
    assert 'near it are "potentiometer reversed"' in capsys.readouterr().err
    assert main(["serve", "--finger", "--wire", "potentiometer reversed"]) == 2
    assert "leave --wire out" in capsys.readouterr().err


def test_pymodbus_reads_over_tcp(boards: Boards) -> None:
    async def read() -> list[int]:
        host, port = boards["drum"]["tcp"].split(":")
        client = AsyncModbusTcpClient(
            host, port=int(port), framer=FramerType.RTU, timeout=DEADLINE_S
        )
        await client.connect()
        reply = await client.read_holding_registers(16, count=40, device_id=1)
        client.close()
        return list(reply.registers)

    assert len(asyncio.run(read())) == 40


def test_pyserial_reads_the_taxels_and_two_programs_read_the_same(boards: Boards) -> None:
    host, port = boards["taxels"]["tcp"].split(":")
    with (
        serial.Serial(boards["taxels"]["pty"], 500_000, timeout=DEADLINE_S) as first,
        serial.serial_for_url(f"socket://{host}:{port}", timeout=DEADLINE_S) as second,
    ):
        for port_of in (first, second):
            decoder = FrameDecoder(18)
            decoder.feed(port_of.read(33), 0.0)
            decoded = decoder.feed(port_of.read(33 * 100), 0.0)
            (block,) = decoded.blocks
            assert len(block) >= 95
            assert not block.gaps
