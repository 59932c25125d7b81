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

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine
from rigctl.errors import WrongUse

BOARDS = ("drum", "taxels", "finger")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("board", nargs="?", choices=BOARDS, help="which board")
    parser.add_argument("--port", help="its port, such as /dev/ttyACM0 or COM4; default: find it")
    add_option(
        parser,
        "--image",
        a_path,
        "FILE.hex",
        "another image than that of this installation; the finger's is exported by the Arduino IDE",
    )
    add_option(
        parser,
        "--sketches",
        a_path,
        "DIR",
        "write the sketches of all boards below this folder, and flash nothing",
    )
    add_option(
        parser,
        "--model",
        a_path,
        "FILE.h",
        "with --sketches: a model of `rigctl realtime board` for the finger's sketch",
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
    from rigctl.boards.flash import write_sketches

    if args.board is not None or args.image is not None or args.port is not None:
        raise WrongUse("--sketches writes folders and flashes nothing: leave the board out")
    for folder in write_sketches(args.sketches, args.model):
        print(f"{folder}: open {folder.name}.ino in the Arduino IDE and upload it")
    return 0


async def _flash_avr(args: argparse.Namespace, line: ProgressLine) -> None:
    from rigctl.boards.flash import flash_board

    flashed = await flash_board(args.board, line.show_share, args.port or "", args.image)
    line.end()
    if flashed.remark:
        line.say(flashed.remark)
    print(flashed.text)


async def _flash_teensy(args: argparse.Namespace, line: ProgressLine) -> None:
    from rigctl.boards.flash import (
        Flashed,
        find_identity,
        read_image,
        require_teensy_image,
        write_teensy,
    )

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
    print(Flashed(port, identity, "").text)
