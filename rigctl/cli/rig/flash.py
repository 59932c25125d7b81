"""Write the firmware of this installation to a board.

Find the board (by its name, else by the signature that its bootloader tells), write the image with
avrdude, or with teensy_loader_cli to the Teensy of the finger, verify it, and read the board's
name. A board of another kind is refused, and an interrupted flash begins again; a board whose flash
was interrupted switches nothing on, so run the command again. --sketches writes folders for the
Arduino IDE instead. Exit code 1: the board runs another build than was written; 2: wrong board, or
avrdude is missing; 3: the port or the board failed.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
from typing import TYPE_CHECKING

from rigctl.cli.options.arguments import a_path
from rigctl.cli.options.progress import ProgressLine
from rigctl.errors import CheckFailed, WrongUse

if TYPE_CHECKING:
    from rigctl.values import BoardIdentity

BOARDS = ("drum", "taxels", "finger")
SEARCHING = (
    "looking for the board: a bootloader may be listening, so every port stays silent for 2 s"
)
RESTARTS_FOR_EVER = (
    "this Nano has the old bootloader: after a hang of its program it restarts for ever, until its "
    "USB cable is pulled; burn Optiboot (in the Arduino IDE: Nano, Burn Bootloader) to cure that"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("board", nargs="?", choices=BOARDS, help="which board")
    parser.add_argument("--port", help="its port, such as /dev/ttyACM0 or COM4; default: find it")
    parser.add_argument(
        "--image",
        type=a_path("--image"),
        metavar="FILE.hex",
        help="another image than that of this installation; the finger's is exported by the "
        "Arduino IDE",
    )
    parser.add_argument(
        "--sketches",
        type=a_path("--sketches"),
        metavar="DIR",
        help="write the sketches of all boards below this folder, and flash nothing",
    )
    parser.add_argument(
        "--model",
        type=a_path("--model"),
        metavar="FILE.h",
        help="with --sketches: a model of `rigctl realtime board` for the finger's sketch",
    )


def run(args: argparse.Namespace) -> int:
    """Flash a board, or write the sketches."""
    if args.sketches is not None:
        return _write_sketches(args)
    if args.model is not None:
        raise WrongUse("--model belongs to --sketches: add it")
    if args.board is None:
        raise WrongUse(f"say which board to flash: {', '.join(BOARDS)}; or give --sketches DIR")
    flash = _flash_teensy if args.board == "finger" else _flash_avr
    asyncio.run(flash(args, ProgressLine(sys.stderr)))
    return 0


def _write_sketches(args: argparse.Namespace) -> int:
    from rigctl.devices.flashing.sketches import write_sketches

    if args.board is not None or args.image is not None or args.port is not None:
        raise WrongUse("--sketches writes folders and flashes nothing: leave the board out")
    for folder in write_sketches(args.sketches, args.model):
        print(f"{folder}: open {folder.name}.ino in the Arduino IDE and upload it")
    return 0


async def _flash_avr(args: argparse.Namespace, line: ProgressLine) -> None:
    from rigctl.devices.flashing.bootloader import OLD_NANO
    from rigctl.devices.flashing.flash import find_port, flash_avr, installed_image, read_image

    build_hash = ""
    path = args.image
    if path is None:
        path, build_hash = installed_image(args.board)
    image = read_image(path)
    loop = asyncio.get_running_loop()
    if args.port is None:
        line.say(SEARCHING)
    port = args.port or await find_port(args.board, loop)
    line.say(f"{port}: {path.name}, build {build_hash or 'unknown'}")
    kind, identity = await flash_avr(args.board, port, image, loop, line.show_share)
    line.end()
    if kind is OLD_NANO:
        line.say(RESTARTS_FOR_EVER)
    _require_build(port, identity, build_hash)
    print(_described(port, identity))


async def _flash_teensy(args: argparse.Namespace, line: ProgressLine) -> None:
    from rigctl.devices.flashing.flash import find_identity, read_image
    from rigctl.devices.flashing.teensy_flash import require_teensy_image, write_teensy

    if args.image is None:
        raise WrongUse(
            "the finger's image is built by the Arduino IDE with Teensyduino: write its sketch "
            "with rigctl flash --sketches DIR, export it (Sketch, Export Compiled Binary), then "
            "give the .hex with --image"
        )
    image = read_image(args.image)
    require_teensy_image(args.image, image)
    await write_teensy(args.image, line.say)
    line.say("reading the identity")
    port, identity = await find_identity("finger", args.port, asyncio.get_running_loop())
    print(_described(port, identity))


def _require_build(port: str, identity: BoardIdentity, build_hash: str) -> None:
    if build_hash and identity.build_hash != build_hash:
        raise CheckFailed(
            f"{port}: build {build_hash} was written and verified, and the board reports "
            f"{identity.build_hash}: run the command again, and make firmware in a checkout"
        )


def _described(port: str, identity: BoardIdentity) -> str:
    return (
        f"{port}: {identity.board} board, firmware {identity.firmware_version}, build "
        f"{identity.build_hash}"
    )
