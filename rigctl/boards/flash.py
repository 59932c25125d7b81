"""Write firmware onto boards: bootloaders, avrdude and the Teensy loader, sketches."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import reduce
from operator import xor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from serial.tools import list_ports

from rigctl.boards.links import SerialLink
from rigctl.boards.port_discovery import probe_ports, read_identity
from rigctl.config.intel_hex import Segments, format_intel_hex, parse_intel_hex
from rigctl.config.resources import checkout, flash_image, sketch_sources
from rigctl.config.text_file import read_text
from rigctl.errors import CheckFailed, LinkLost, RigFault, WrongUse
from rigctl.host_build import image_hash
from rigctl.values import BoardIdentity

AVRDUDE, TEENSY_LOADER = "avrdude", "teensy_loader_cli"
_INSTALL = {
    AVRDUDE: {
        "linux": "sudo apt install avrdude",
        "darwin": "brew install avrdude",
        "win32": "winget install AVRDudes.AVRDUDE",
    },
    TEENSY_LOADER: {
        "linux": "sudo apt install teensy-loader-cli",
        "darwin": "brew install teensy_loader_cli",
        "win32": "get it from https://www.pjrc.com/teensy/loader_cli.html and put it on the PATH",
    },
}
_ARDUINO_IDE = {"darwin": "~/Library/Arduino15", "win32": "~/AppData/Local/Arduino15"}
"""Where the IDE keeps its tools; ``~/.arduino15`` on other systems."""


@dataclass(frozen=True, slots=True)
class ProgramRun:
    """How a run of a program ended: its exit code, None where it was ended, and its last words."""

    exit_code: int | None
    output: str


def find_program(name: str) -> list[str]:
    """Return the command of a program: that of the PATH, or avrdude of the Arduino IDE.

    Raises WrongUse with the line that installs it.
    """
    if path := shutil.which(name):
        return [path]
    folder = Path(_ARDUINO_IDE.get(sys.platform, "~/.arduino15")).expanduser()
    suffix = ".exe" if sys.platform == "win32" else ""
    for tool in sorted(folder.glob(f"packages/*/tools/{name}/*/bin/{name}{suffix}"), reverse=True):
        return [str(tool), "-C", str(tool.parents[1] / "etc" / f"{name}.conf")]
    line = _INSTALL[name].get(sys.platform, _INSTALL[name]["linux"])
    raise WrongUse(f"{name} is not installed: {line}")


async def run_program(
    command: Sequence[str], stall_s: float, progressed: Callable[[str], bool]
) -> ProgramRun:
    """Run a program and return how it ended; it is ended after ``stall_s`` without progress.

    ``progressed(text)`` gets what the program prints, as it comes, and returns whether that shows
    progress.
    """
    loop = asyncio.get_running_loop()
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env=os.environ | {"LC_ALL": "C"},
    )
    assert process.stdout is not None
    output = ""
    deadline_s = loop.time() + stall_s
    try:
        while True:
            async with asyncio.timeout_at(deadline_s):
                data = await process.stdout.read(256)
            if not data:
                return ProgramRun(await process.wait(), output)
            text = data.decode(errors="replace")
            output += text
            if progressed(text):
                deadline_s = loop.time() + stall_s
    except TimeoutError:
        return ProgramRun(None, output)
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


ANSWER_S = 0.15
"""A bootloader answers within some milliseconds, USB included."""
CLOSED_S = 0.1
"""The board sees that the port was closed before the next program opens it."""
SYNC_ATTEMPTS = 6
"""An Uno's bootloader blinks for a third of a second before it listens."""

_GET_SYNC, _READ_SIGNATURE = b"0 ", b"u "
_IN_SYNC, _SIGNATURE = re.compile(b"\x14\x10"), re.compile(b"\x14\x1e..\x10", re.DOTALL)
"""STK500, AVR061: in sync, the answer, OK. Atmel's signatures begin with 1e."""
_MESSAGE_START, _TOKEN = 0x1B, 0x0E
_SIGN_ON, _SPI_MULTI = 0x01, 0x1D
_SIGNED_ON = re.compile(b"\x1b\x01\x00\x0b\x0e\x01\x00.{10}", re.DOTALL)
_SIGNATURE_BYTE = re.compile(b"\x1b\x01\x00\x07\x0e\x1d\x00....\x00.", re.DOTALL)
"""STK500 version 2, AVR068: start, number, size, token, command, status, answer, checksum."""


@dataclass(frozen=True, slots=True)
class BootloaderKind:
    """A kind of bootloader: how it is called, and ``programmer`` and ``baud`` for avrdude."""

    name: str
    programmer: str
    baud: int


MEGA = BootloaderKind("Mega bootloader", "wiring", 115_200)
OPTIBOOT = BootloaderKind("Optiboot", "arduino", 115_200)
OLD_NANO = BootloaderKind("old Nano bootloader", "arduino", 57_600)


async def ask_signature(
    port: str, kind: BootloaderKind, loop: asyncio.AbstractEventLoop
) -> bytes | None:
    """Reset the board and return the three bytes of its chip's signature.

    None where no bootloader of this ``kind`` answers. Raises LinkLost where the port cannot be
    opened or vanishes.
    """
    link = SerialLink(port, kind.baud, loop)
    line = _Line(link)
    try:
        await link.reset_board()
        return await (_ask_v2(line) if kind is MEGA else _ask_v1(line))
    finally:
        link.close()
        await asyncio.sleep(CLOSED_S)


class _Line:
    """Requests over one open link, each with the bytes that answer it in time."""

    def __init__(self, link: SerialLink) -> None:
        self._link = link
        self._received = b""
        self._changed = asyncio.Event()
        link.open(self._take, lambda reason: self._changed.set())

    async def ask(self, request: bytes, answer: re.Pattern[bytes]) -> bytes | None:
        """Return what fits the ``answer``; None where it does not come in time.

        It may come behind late answers to earlier requests, as on a busy computer.
        """
        self._received = b""
        self._link.write(request)
        try:
            async with asyncio.timeout(ANSWER_S):
                while not (found := answer.search(self._received)):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return None
        return found[0]

    def _take(self, data: bytes, at_s: float) -> None:
        self._received += data
        self._changed.set()


async def _ask_v1(line: _Line) -> bytes | None:
    for _ in range(SYNC_ATTEMPTS):
        if await line.ask(_GET_SYNC, _IN_SYNC):
            answer = await line.ask(_READ_SIGNATURE, _SIGNATURE)
            return answer and answer[1:4]
    return None


async def _ask_v2(line: _Line) -> bytes | None:
    for _ in range(SYNC_ATTEMPTS):
        if _is_whole(await line.ask(_message(_SIGN_ON), _SIGNED_ON) or b""):
            requests = (_message(_SPI_MULTI, 4, 4, 0, 0x30, 0, index, 0) for index in range(3))
            answers = [await line.ask(request, _SIGNATURE_BYTE) or b"" for request in requests]
            is_whole = all(map(_is_whole, answers))
            return b"".join(each[10:11] for each in answers) if is_whole else None
    return None


def _is_whole(message: bytes) -> bool:
    """Return whether a message has come, and its checksum is right."""
    return bool(message) and not reduce(xor, message)


def _message(*body: int) -> bytes:
    head = bytes([_MESSAGE_START, 1, 0, len(body), _TOKEN, *body])
    return head + bytes([reduce(xor, head)])


MCU = "TEENSY40"
FLASH_BASE, FLASH_BYTES = 0x6000_0000, 2_031_616
"""Where the chip maps its external flash, and how much of it PJRC's core offers."""
BUTTON_S = 60.0
"""How long the person may take to press the button."""


def require_teensy_image(path: Path, image: Segments) -> None:
    """Raise WrongUse for an image that is not one for a Teensy 4.0."""
    end = image[-1][0] + len(image[-1][1])
    if image[0][0] < FLASH_BASE or end > FLASH_BASE + FLASH_BYTES:
        raise WrongUse(
            f"{path} is an image for another board: in the Arduino IDE select Teensy 4.0, then "
            "Sketch, Export Compiled Binary"
        )


async def write_teensy(path: Path, report: Callable[[str], None]) -> None:
    """Write an image. Raises WrongUse without the loader, LinkLost where no Teensy takes it."""
    command = [*find_program(TEENSY_LOADER), f"--mcu={MCU}", "-w", "-v", str(path)]
    report(f"press the button on the Teensy, within {BUTTON_S:g} s")

    def progressed(text: str) -> bool:
        is_found = "Found" in text or "Programming" in text
        if is_found:
            report("writing")
        return is_found

    done = await run_program(command, BUTTON_S, progressed)
    if done.exit_code != 0:
        last = (done.output.split("\n")[-2:] or [""])[0].strip()
        what = "no Teensy was found" if done.exit_code is None else f"the loader ended ({last})"
        raise LinkLost(
            f"{what}: connect the Teensy 4.0 by USB, press its button, and run the same command "
            "again"
        )


PAGE_BYTES = 256
"""A page of the ATmega2560, two of the ATmega328P."""
WAIT_FOR_EVER = bytes.fromhex(
    "f894"  # cli
    "1124 14be"  # eor r1, r1; out MCUSR, r1
    "a895 88e1 80936000 10926000"  # wdr; the watchdog off, by both writes to WDTCSR
    "0000 fecf"  # nop; rjmp back to it
)
"""The same on both chips."""
STALL_S = 8.0
"""avrdude writes a fiftieth of an image in less than a second; it gives up after a minute."""
ATTEMPTS = 3
RETURN_S = 10.0
"""How long a port that vanished may take to come back."""
LOOK_AGAIN_S = 0.5

Report = Callable[[str, float], None]
"""Called with what happens, and how much of it is done, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Chip:
    """A chip that can be flashed: its names, its signature, and the room for a program."""

    name: str
    avrdude_part: str
    signature: bytes
    room_bytes: int
    bootloaders: tuple[BootloaderKind, ...]


ATMEGA2560 = Chip("ATmega2560", "atmega2560", b"\x1e\x98\x01", 0x3E000, (MEGA,))
ATMEGA328P = Chip("ATmega328P", "atmega328p", b"\x1e\x95\x0f", 0x7800, (OPTIBOOT, OLD_NANO))
CHIPS = {"drum": ATMEGA2560, "taxels": ATMEGA328P}
"""The chip of each board."""
_NAMES = {chip.signature: f"an {chip.name}" for chip in (ATMEGA2560, ATMEGA328P)} | {
    b"\x1e\x95\x16": "an ATmega328PB",
    b"\x1e\x95\x87": "an ATmega32U4 (Leonardo, Micro)",
}


async def find_bootloader(port: str, chip: Chip, loop: asyncio.AbstractEventLoop) -> BootloaderKind:
    """Return the bootloader of the ``chip`` on ``port``.

    Raises WrongUse where a bootloader answers for another chip, LinkLost where none answers.
    """
    others = (kind for other in CHIPS.values() for kind in other.bootloaders)
    kinds = dict.fromkeys((*chip.bootloaders, *others))
    for kind in (*kinds, *kinds):  # again, because a busy computer may miss the moment of a reset
        signature = await ask_signature(port, kind, loop)
        if signature == chip.signature:
            return kind
        if signature is not None:
            name = _NAMES.get(signature, "another chip")
            raise WrongUse(
                f"{port}: {name} is there (signature {signature.hex()}), and this firmware is for "
                f"an {chip.name}: give the port of the other board; nothing was changed"
            )
    raise LinkLost(
        f"{port}: no bootloader answered: check the cable, and that no other program holds the "
        "port; nothing was changed"
    )


async def write_image(
    port: str,
    chip: Chip,
    kind: BootloaderKind,
    image: Segments,
    report: Report,
    is_there: Callable[[str], bool],
) -> None:
    """Write and verify an image with avrdude; begin again after an interruption.

    ``is_there(port)`` says whether the port exists. Raises WrongUse for an image that does not fit
    or without avrdude, LinkLost where the flash does not succeed.
    """
    end = image[-1][0] + len(image[-1][1])
    if end > chip.room_bytes:
        raise WrongUse(
            f"the image ends at byte {end:,}, and an {chip.name} with its bootloader has room for "
            f"{chip.room_bytes:,}: it is an image for another board"
        )
    program = find_program(AVRDUDE)
    with TemporaryDirectory(prefix="rigctl-flash-") as folder:
        parts = _write_parts(Path(folder), image)
        writes = [word for path, _ in parts for word in ("-U", f"flash:w:{path}:i")]
        options = ("-p", chip.avrdude_part, "-c", kind.programmer, "-b", str(kind.baud), "-D")
        for attempt in range(1, ATTEMPTS + 1):
            progress = _Progress([size for _, size in parts], report, attempt)
            done = await run_program([*program, *options, "-P", port, *writes], STALL_S, progress)
            if done.exit_code == 0:
                return
            await _wait_for(port, is_there)
    raise LinkLost(
        f"{port}: flashing was interrupted {ATTEMPTS} times, the last time {_reason(done)}. The "
        "board keeps its bootloader and switches nothing on: check cable and port, then run the "
        "same command again"
    )


def guarded_parts(image: Segments) -> tuple[Segments, Segments, Segments]:
    """Return what is written first, then, and last: a loop, all pages but the first, and that."""
    wait = WAIT_FOR_EVER.ljust(PAGE_BYTES, b"\xff")
    rest = [
        (max(start, PAGE_BYTES), data[max(0, PAGE_BYTES - start) :])
        for start, data in image
        if start + len(data) > PAGE_BYTES
    ]
    first = [(start, data[: PAGE_BYTES - start]) for start, data in image if start < PAGE_BYTES]
    return [(0, wait)], rest, first


def _write_parts(folder: Path, image: Segments) -> list[tuple[Path, int]]:
    """Write the parts as files; return them with their sizes in bytes."""
    files = []
    for number, part in enumerate(guarded_parts(image)):
        if part:
            path = folder / f"{number}.hex"
            path.write_text(format_intel_hex(part), encoding="ascii")
            files.append((path, sum(len(data) for _, data in part)))
    return files


class _Progress:
    """Follows avrdude's bars, of 50 marks each: one for each part that is written or read back."""

    def __init__(self, sizes: list[int], report: Report, attempt: int) -> None:
        self._sizes = [size for size in sizes for _ in ("written", "read back")]
        self._report = report
        self._what = "writing" if attempt == 1 else f"writing, attempt {attempt}"
        self._text = ""

    def __call__(self, text: str) -> bool:
        """Return whether ``text`` shows progress, and report it."""
        before = self._marks()
        self._text += text
        marks = self._marks()
        if marks == before:
            return False
        shares = (size * count / 50 for size, count in zip(self._sizes, marks, strict=False))
        self._report(self._what, min(1.0, sum(shares) / sum(self._sizes)))
        return True

    def _marks(self) -> list[int]:
        """Return the marks of the bars from the first that writes."""
        _, _, bars = self._text.partition("Writing |")
        return [bar.count("#") for bar in bars.replace("Reading |", "Writing |").split("Writing |")]


async def _wait_for(port: str, is_there: Callable[[str], bool]) -> None:
    """Return a moment later when the port is there. Raises LinkLost where it does not come back."""
    await asyncio.sleep(LOOK_AGAIN_S)
    loop = asyncio.get_running_loop()
    deadline_s = loop.time() + RETURN_S
    while not is_there(port):
        if loop.time() > deadline_s:
            raise LinkLost(
                f"{port}: the port vanished while the board was flashed. The board keeps its "
                "bootloader and switches nothing on: plug it in, then run the same command again"
            )
        await asyncio.sleep(LOOK_AGAIN_S)


def _reason(done: ProgramRun) -> str:
    if done.exit_code is None:
        return f"without an answer for {STALL_S:g} s"
    lines = [line for line in done.output.splitlines() if "rror" in line or "mismatch" in line]
    return f"by avrdude: {lines[-1].removeprefix('avrdude').strip(' :')}" if lines else "by avrdude"


BOARDS = ("drum", "taxels", "finger")
SHARED = {"finger": ("taxels/cobs.cpp", "taxels/cobs.h", "taxels/crc32.cpp", "taxels/crc32.h")}
"""The finger board frames its bytes as the taxel board does."""
MODEL_FILE = "trained_model.h"
"""The name under which the finger's sketch includes a model."""
SUFFIXES = {".ino", ".cpp", ".h"}
MAX_MODEL_BYTES = 4 * 2**20


def write_sketches(folder: Path, model: Path | None = None) -> list[Path]:
    """Write the sketches below ``folder`` and return theirs; ``model``: a header for the finger's.

    Raises WrongUse where one is there already, or for what is no model.
    """
    there = [folder / board for board in BOARDS if (folder / board).exists()]
    if there:
        raise WrongUse(f"{there[0]} exists already: give another folder, or remove it")
    model_text = _model_text(model) if model else None
    sources = sketch_sources()
    try:
        for board in BOARDS:
            (folder / board).mkdir(parents=True)
            paths = [path for path in (sources / board).iterdir() if path.suffix in SUFFIXES]
            for path in (*paths, *(sources / name for name in SHARED.get(board, ()))):
                (folder / board / path.name).write_bytes(path.read_bytes())
        if model_text is not None:
            (folder / "finger" / MODEL_FILE).write_text(model_text, encoding="utf-8")
    except OSError as error:
        raise WrongUse(f"cannot write below {folder}: {error.strerror}") from error
    return [folder / board for board in BOARDS]


def _model_text(path: Path) -> str:
    text = read_text(path, MAX_MODEL_BYTES, WrongUse)
    if "FINGER_CLASSIFIER" not in text:
        raise WrongUse(
            f"{path} is no model of the finger board: write one with "
            "`rigctl realtime board MODEL --out FILE.h`"
        )
    return text


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
