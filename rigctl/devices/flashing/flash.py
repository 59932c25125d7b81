"""The steps of a flash: find the board, ask its bootloader, write, and read the identity back."""

from __future__ import annotations

import asyncio
import os
from pathlib import Path
from typing import NamedTuple

from serial.tools import list_ports

from rigctl.config.intel_hex import Segments, parse_intel_hex
from rigctl.config.resources import checkout, flash_image
from rigctl.config.text_file import read_text
from rigctl.devices.flashing.avr_flash import (
    CHIPS,
    RETURN_S,
    Chip,
    Report,
    find_bootloader,
    write_image,
)
from rigctl.devices.flashing.bootloader import OLD_NANO
from rigctl.devices.port_discovery import probe_ports, read_identity
from rigctl.errors import CheckFailed, LinkLost, RigFault, WrongUse
from rigctl.host_build import image_hash
from rigctl.values import BoardIdentity

MAX_IMAGE_BYTES = 16 * 2**20
AFTER_WRITING_S = 0.5
"""The port may be held for a moment by the program that has just ended."""
SEARCHING = (
    "looking for the board: a bootloader may be listening, so every port stays silent for 2 s"
)
RESTARTS_FOR_EVER = (
    "this Nano has the old bootloader: after a hang of its program it restarts for ever, until its "
    "USB cable is pulled; burn Optiboot (in the Arduino IDE: Nano, Burn Bootloader) to cure that"
)


class Flashed(NamedTuple):
    """A board that was flashed: its port, what it reports, a ``remark``, empty for none."""

    port: str
    identity: BoardIdentity
    remark: str

    @property
    def text(self) -> str:
        """The board in words."""
        board = self.identity
        return (
            f"{self.port}: {board.board} board, firmware {board.firmware_version}, build "
            f"{board.build_hash}"
        )


def read_image(path: Path) -> Segments:
    """Return the bytes of an image. Raises WrongUse where the file is not whole Intel HEX."""
    text = read_text(path, MAX_IMAGE_BYTES, WrongUse)
    try:
        return parse_intel_hex(text)
    except WrongUse as error:
        raise WrongUse(f"{path} is not an image in Intel HEX: {error}") from error


def installed_image(board: str) -> tuple[Path, str]:
    """Return the image of this installation and its build hash.

    Raises WrongUse without one, or where the sources of a checkout have changed since.
    """
    path, build_hash = flash_image(board)
    if checkout() is not None and build_hash != image_hash(board):
        raise WrongUse(f"{path} is older than its sources: run make firmware")
    return path, build_hash


async def find_identity(
    board: str, port: str | None, loop: asyncio.AbstractEventLoop
) -> tuple[str, BoardIdentity]:
    """Return port and identity of a board that starts now; search it where no port is given."""
    deadline_s = loop.time() + RETURN_S
    while True:
        for report in await probe_ports(loop, [port] if port else ()):
            if report.identity is not None and report.identity.board == board:
                return report.port, report.identity
        if loop.time() > deadline_s:
            raise LinkLost(
                f"the image was written, but no {board} board answers: rigctl ports lists what is "
                "there"
            )


async def find_port(board: str, loop: asyncio.AbstractEventLoop) -> str:
    """Return the port of the board, by its identity, else by the signature of its chip.

    Raises LinkLost where there is none, WrongUse where there are several.
    """
    reports = await probe_ports(loop)
    ports = [r.port for r in reports if r.identity is not None and r.identity.board == board]
    if not ports:
        usb_ports = {info.device for info in list_ports.comports() if info.vid is not None}
        unknown = [r.port for r in reports if r.identity is None and r.port in usb_ports]
        ports = [port for port in unknown if await _has_chip(port, CHIPS[board], loop)]
    if not ports:
        raise LinkLost(
            f"no {board} board was found, and no bootloader of an {CHIPS[board].name} answered: "
            "plug the board in, or give its port with --port; rigctl ports lists what is there"
        )
    if len(ports) > 1:
        raise WrongUse(f"{' and '.join(ports)} fit: say which with --port")
    return ports[0]


async def flash_board(
    board: str, report: Report, port: str = "", path: Path | None = None
) -> Flashed:
    """Write the image of this installation, or that at ``path``, verify it and read the identity.

    Without a ``port`` the board is searched. Raises WrongUse for the wrong board, LinkLost where it
    is not found or cannot be written, WrongBoard where what answers afterwards is not this board
    with this version, CheckFailed where it reports another build than was written.
    """
    loop, chip, build_hash = asyncio.get_running_loop(), CHIPS[board], ""
    if path is None:
        path, build_hash = installed_image(board)
    image = read_image(path)
    if not port:
        report(SEARCHING, 0.0)
        port = await find_port(board, loop)
    report(f"{port}: {path.name}, build {build_hash or 'unknown'}", 0.0)
    report("asking the bootloader", 0.0)
    kind = await find_bootloader(port, chip, loop)
    await write_image(port, chip, kind, image, report, _exists)
    report("reading the identity: silent for 2 s first", 1.0)
    await asyncio.sleep(AFTER_WRITING_S)
    identity = await read_identity(port, board, loop)
    if build_hash and identity.build_hash != build_hash:
        raise CheckFailed(
            f"{port}: build {build_hash} was written and verified, and the board reports "
            f"{identity.build_hash}: flash it again, after make firmware in a checkout"
        )
    return Flashed(port, identity, RESTARTS_FOR_EVER if kind is OLD_NANO else "")


async def _has_chip(port: str, chip: Chip, loop: asyncio.AbstractEventLoop) -> bool:
    try:
        await find_bootloader(port, chip, loop)
    except (RigFault, WrongUse):
        return False
    return True


def _exists(port: str) -> bool:
    if os.name == "posix":
        return Path(port).exists()
    return any(info.device == port for info in list_ports.comports())
