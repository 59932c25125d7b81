"""Print a simulated bench as a world file.

Print every parameter of a simulated bench with its range, unit and meaning, as a file that
--world takes. Exit code 2: the file or session has no such bench.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.arguments import a_path, add_option
from rigctl.errors import SessionError

if TYPE_CHECKING:
    from rigctl.bench.world_file import SimulatedWorld


def add_world(parser: argparse.ArgumentParser) -> None:
    """Add ``--world FILE`` to a command that opens a simulated rig."""
    add_option(
        parser,
        "--world",
        a_path,
        "FILE",
        "a simulated rig's plates, sensor and mechanics; `rigctl world` prints them",
    )


def add_wirings(parser: argparse.ArgumentParser) -> None:
    """Add ``--wire NAME`` to a command that opens a simulated rig."""
    parser.add_argument(
        "--wire",
        type=_wiring_name,
        action="append",
        default=[],
        metavar="NAME",
        help='wire a simulated rig wrongly, such as "actuator swapped"; may be repeated '
        "(docs/reference/world.md lists the names)",
    )


def chosen_world(path: Path | None) -> SimulatedWorld | None:
    """Return the world of a file, None without a file. Raises ConfigError."""
    from rigctl.bench.world_file import load_world

    return None if path is None else load_world(path)


def session_world(folder: Path) -> SimulatedWorld | None:
    """Return the world of a session, None if it has none. Raises SessionError."""
    from rigctl.bench.world_file import world_from_header
    from rigctl.session.session import Session

    with Session.open(folder) as session:
        return world_from_header(session.header.simulation, folder)


def _wiring_name(text: str) -> str:
    """Return the name of a wiring as the catalogue has it. Raises WrongUse."""
    from rigctl.bench.wirings import find_wiring

    return find_wiring(text).name


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser,
        "source",
        a_path,
        "FILE|SESSION",
        "a world file to complete, or a session; default: the nominal bench",
        nargs="?",
    )


def run(args: argparse.Namespace) -> int:
    """Print the world."""
    from rigctl.bench.world_file import NOMINAL_WORLD, format_world

    if args.source is not None and args.source.is_dir():
        world = session_world(args.source)
        if world is None:
            raise SessionError(
                f"{args.source} contains no simulated bench: it was not recorded on one"
            )
    else:
        world = chosen_world(args.source) or NOMINAL_WORLD
    print(format_world(world.parameters), end="")
    return 0
