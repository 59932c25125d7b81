"""Flash a Mega, an Uno or a Nano by its bootloader, so that an interruption leaves nothing unsafe.

The program's first page is written first with an endless loop, and with its own bytes last: a chip
whose flash was interrupted runs this loop, and its pins stay inputs, which the rig's resistors hold
at the levels that switch the drivers off.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rigctl.config.intel_hex import Segments, format_intel_hex
from rigctl.devices.flashing.bootloader import (
    MEGA,
    OLD_NANO,
    OPTIBOOT,
    BootloaderKind,
    ask_signature,
)
from rigctl.devices.flashing.programs import AVRDUDE, ProgramRun, find_program, run_program
from rigctl.errors import LinkLost, WrongUse

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
