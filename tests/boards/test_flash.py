"""rigctl flash through avrdude itself, against the real bootloaders on simulated chips."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo

from rigctl.bench.chips.simavr import Kind
from rigctl.boards import flash
from rigctl.boards.flash import (
    ATMEGA2560,
    WAIT_FOR_EVER,
    ask_signature,
    find_port,
    guarded_parts,
    write_image,
)
from rigctl.boards.flash import MEGA as MEGA_KIND
from rigctl.cli import main
from rigctl.config.intel_hex import Segments, format_intel_hex, parse_intel_hex
from rigctl.config.resources import checkout
from rigctl.errors import LinkLost, WrongUse
from tests.boards.flash_board import FlashBoard
from tests.firmware.bootloaders import MEGA, OLD_NANO, UNO
from tests.firmware.building import built

OLD = {"drum": "firmware/drum-hangs.elf", "taxels": "firmware/taxels-never-kick.elf"}
"""Another build of each firmware, which is on the board before."""


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give a bootloader more time than on a bench: chips run slower on a busy computer."""
    monkeypatch.setattr("rigctl.boards.flash.ANSWER_S", 0.25)
    monkeypatch.setattr("rigctl.boards.flash.CLOSED_S", 0.5)
    monkeypatch.setattr("rigctl.boards.boot_silence.ASK_S", 4.0)


def new_board(board: str, bootloader: Path) -> FlashBoard:
    built(f"firmware/{board}.hex")
    kind = Kind.DRUM if board == "drum" else Kind.TAXELS
    return FlashBoard(built(OLD[board]), kind, bootloader)


def image_of(board: str) -> Segments:
    return parse_intel_hex(built(f"firmware/{board}.hex").read_text())


def bytes_of(there: FlashBoard, image: Segments) -> Segments:
    """Return what is in the chip's flash where the image has bytes."""
    return [(start, there.chip.read_flash(start, len(data))) for start, data in image]


@pytest.mark.parametrize(
    ("board", "bootloader"),
    [("drum", MEGA), ("taxels", UNO), ("taxels", OLD_NANO)],
    ids=["mega", "uno", "old nano"],
)
def test_a_board_is_written_verified_and_identified(
    board: str, bootloader: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = image_of(board)
    with new_board(board, bootloader) as there:
        assert bytes_of(there, image) != image
        assert main(["flash", board, "--port", there.port]) == 0
        assert bytes_of(there, image) == image
        out, progress = capsys.readouterr()
        build = built(f"firmware/{board}.hex").with_suffix(".build").read_text().strip()
        assert out.startswith(f"{there.port}: {board} board, firmware ")
        assert out.endswith(f", build {build}\n")
        assert "asking the bootloader" in progress and "writing" in progress
        assert ("it restarts for ever" in progress) == (bootloader == OLD_NANO)


@pytest.mark.parametrize(
    ("firmware", "board", "bootloader", "sentence"),
    [
        ("drum", "taxels", UNO, "an ATmega328P is there (signature 1e950f), and this firmware is"),
        ("taxels", "drum", MEGA, "an ATmega2560 is there (signature 1e9801), and this firmware"),
    ],
)
def test_the_wrong_board_is_refused_by_its_signature(
    firmware: str, board: str, bootloader: Path, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with new_board(board, bootloader) as there:
        before = there.chip.read_flash(0, 4096)
        assert main(["flash", firmware, "--port", there.port]) == 2
        assert sentence in capsys.readouterr().err
        assert there.chip.read_flash(0, 4096) == before


def usb_port(device: str, vid: int | None = 0x2341, description: str = "") -> ListPortInfo:
    """Return a port as pyserial lists it."""
    info = ListPortInfo(device)
    info.vid, info.pid, info.description = vid, 0x0042, description
    return info


def test_the_board_is_found_by_its_name_else_by_the_signature_of_its_chip(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def find(board: str) -> str:
        async def search() -> str:
            return await find_port(board, asyncio.get_running_loop())

        return asyncio.run(search())

    with new_board("drum", MEGA) as mega, new_board("taxels", UNO) as uno:
        uno.chip.write_flash(0, WAIT_FOR_EVER.ljust(256, b"\xff"))
        ports = [usb_port(mega.port), usb_port(uno.port)]
        monkeypatch.setattr("serial.tools.list_ports.comports", lambda: ports)
        assert find("drum") == mega.port
        assert find("taxels") == uno.port
        ports[1:] = []
        with pytest.raises(LinkLost, match="no bootloader of an ATmega328P answered: plug the"):
            find("taxels")


def test_a_damaged_message_of_a_mega_names_no_chip() -> None:
    async def ask() -> bytes | None:
        return await ask_signature(there.port, MEGA_KIND, asyncio.get_running_loop())

    with new_board("drum", MEGA) as there:
        there.carry = lambda data: data.replace(ATMEGA2560.signature[1:2], b"\x99")
        assert asyncio.run(ask()) is None
        there.carry = bytes
        assert asyncio.run(ask()) == ATMEGA2560.signature


def test_an_interrupted_flash_begins_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flash, "STALL_S", 6.0)
    image = image_of("taxels")
    with new_board("taxels", UNO) as there:
        interrupted_at: list[int] = []

        def interrupt() -> None:
            """Pull the cable after 4,000 bytes, until the port is opened again."""
            if there.bytes_received > 4000 and not interrupted_at:
                interrupted_at.append(there.times_opened)
            there.deaf = interrupted_at == [there.times_opened]

        there.on_bytes = interrupt
        assert main(["flash", "taxels", "--port", there.port]) == 0
        assert interrupted_at
        assert "writing, attempt 2" in capsys.readouterr().err
        assert bytes_of(there, image) == image


def test_a_board_whose_flash_stays_interrupted_runs_nothing_and_can_be_flashed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(flash, "STALL_S", 6.0)
    monkeypatch.setattr(flash, "ATTEMPTS", 1)
    with new_board("taxels", UNO) as there:

        def interrupt() -> None:
            there.deaf = there.bytes_received > 4000

        there.on_bytes = interrupt
        assert main(["flash", "taxels", "--port", there.port]) == 3
        errors = capsys.readouterr().err
        assert "keeps its bootloader and switches nothing on" in errors
        assert "run the same command again" in errors
        assert there.chip.read_flash(0, len(WAIT_FOR_EVER)) == WAIT_FOR_EVER
        there.on_bytes = lambda: None
        there.deaf = False
        assert main(["flash", "taxels", "--port", there.port]) == 0


def test_a_port_that_is_in_use_or_missing_is_one_sentence(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    import serial

    with new_board("taxels", UNO) as there:
        holder = serial.Serial(there.port, exclusive=True)
        try:
            assert main(["flash", "taxels", "--port", there.port]) == 3
        finally:
            holder.close()
        assert "the port is in use: close the program that holds it" in capsys.readouterr().err
    assert main(["flash", "taxels", "--port", str(tmp_path / "ttyUSB9")]) == 3
    assert "there is no such port: plug the board in" in capsys.readouterr().err


def test_without_avrdude_its_installation_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(flash.sys, "platform", "linux")
    with pytest.raises(WrongUse, match="avrdude is not installed: sudo apt install avrdude"):
        flash.find_program("avrdude")
    tool = tmp_path / ".arduino15/packages/arduino/tools/avrdude/6.3/bin/avrdude"
    tool.parent.mkdir(parents=True)
    tool.write_text("")
    conf = tool.parents[1] / "etc/avrdude.conf"
    assert flash.find_program("avrdude") == [str(tool), "-C", str(conf)]


def script(folder: Path, name: str, text: str) -> Path:
    """Write a program into a folder of the PATH."""
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def test_a_port_that_vanishes_during_the_flash_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    script(tmp_path, "avrdude", "echo 'avrdude: error: programmer is not responding'; exit 1")
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(flash, "RETURN_S", 0.0)
    monkeypatch.setattr(flash, "LOOK_AGAIN_S", 0.01)
    write = partial(write_image, "/dev/ttyUSB7", ATMEGA2560, MEGA_KIND, [(0, b"\0" * 8)])
    with pytest.raises(LinkLost, match=r"the port vanished while .* plug it in, then run the same"):
        asyncio.run(write(lambda what, share: None, lambda port: False))
    with pytest.raises(LinkLost, match=r"interrupted 3 times, .* programmer is not responding"):
        asyncio.run(write(lambda what, share: None, lambda port: True))


def test_the_first_page_is_written_first_as_a_loop_and_last_as_it_is() -> None:
    image = [(0, bytes(range(256)) * 3 + b"end")]
    guard, rest, first = guarded_parts(image)
    assert guard == [(0, WAIT_FOR_EVER.ljust(256, b"\xff"))]
    assert rest == [(256, bytes(range(256)) * 2 + b"end")]
    assert first == [(0, bytes(range(256)))]


def test_an_image_that_is_damaged_or_for_another_board_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = built("firmware/taxels.hex").read_text()
    damaged, cut, large = (tmp_path / f"{name}.hex" for name in ("damaged", "cut", "large"))
    damaged.write_text(text.replace("0C94", "0C95", 1))
    cut.write_text(text[: len(text) // 2])
    large.write_text(format_intel_hex([(0, b"\1" * 40_000)]))
    assert main(["flash", "taxels", "--image", str(damaged), "--port", "x"]) == 2
    assert "is not an image in Intel HEX: line 1 is damaged" in capsys.readouterr().err
    assert main(["flash", "taxels", "--image", str(cut), "--port", "x"]) == 2
    assert "is not an image in Intel HEX" in capsys.readouterr().err
    with new_board("taxels", UNO) as there:
        assert main(["flash", "taxels", "--image", str(large), "--port", there.port]) == 2
        assert "it is an image for another board" in capsys.readouterr().err


@pytest.mark.parametrize("start", [0, 0x100, 0xFFF8, 0x6000_0000])
def test_intel_hex_is_read_as_it_was_written(start: int) -> None:
    segments = [(start, bytes(range(256)) * 3), (start + 0x2_0000, b"abc")]
    assert parse_intel_hex(format_intel_hex(segments)) == segments
    root = checkout()
    assert root is not None
    assert parse_intel_hex(MEGA.read_text())[0][0] == 0x3E000


TEENSY = [(0x6000_0000, b"\1\2\3\4" * 300)]
LOADER = """
[ "$1 $2 $3" = "--mcu=TEENSY40 -w -v" ] || exit 9
echo "Waiting for Teensy device..."
echo 'Found HalfKay Bootloader'
cp "$4" "$TAKEN" && echo Programming..."""


@pytest.fixture
def loader(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[], Segments]:
    """A stand-in for teensy_loader_cli; returns the bytes that it took."""
    folder = tmp_path / "bin"
    folder.mkdir()
    script(folder, "teensy_loader_cli", LOADER)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)
    monkeypatch.setenv("TAKEN", str(tmp_path / "taken.hex"))
    return lambda: parse_intel_hex((tmp_path / "taken.hex").read_text())


def test_the_loader_of_a_teensy_gets_every_byte(
    loader: Callable[[], Segments],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from rigctl.boards import flash

    monkeypatch.setattr(flash, "RETURN_S", 0.0)
    image = tmp_path / "finger.ino.hex"
    image.write_text(format_intel_hex(TEENSY))
    port = str(tmp_path / "ttyACM9")
    assert main(["flash", "finger", "--image", str(image), "--port", port]) == 3
    assert loader() == TEENSY
    errors = capsys.readouterr().err
    assert "press the button on the Teensy" in errors
    assert "the image was written, but no finger board answers" in errors


def test_an_image_that_is_not_a_teensys_is_refused(
    loader: Callable[[], Segments], capsys: pytest.CaptureFixture[str]
) -> None:
    drum = str(built("firmware/drum.hex"))
    assert main(["flash", "finger", "--image", drum]) == 2
    assert "is an image for another board: in the Arduino IDE select Teensy 4.0" in (
        capsys.readouterr().err
    )
    assert main(["flash", "finger"]) == 2
    assert "write its sketch with rigctl flash --sketches DIR" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "say which board to flash: drum, taxels, finger; or give --sketches DIR"),
        (["drum", "--model", "x.h"], "--model belongs to --sketches: add it"),
        (["drum", "--sketches", "x"], "--sketches writes folders and flashes nothing"),
    ],
)
def test_words_that_do_not_fit_are_refused(
    words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["flash", *words]) == 2
    assert sentence in capsys.readouterr().err
