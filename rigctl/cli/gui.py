"""``rigctl gui``: open the window."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from rigctl.errors import WrongUse

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

DESCRIPTION = "Open the window: work the rig, watch samples and spikes, run protocols."


def add_parser(subparsers: Subparsers) -> None:
    """Add the command; Qt is imported only when it runs."""
    parser = subparsers.add_parser("gui", help="open the window", description=DESCRIPTION)
    parser.add_argument(
        "--rig", metavar="RIG", help="connect at once: virtual, firmware, or the path of a rig.toml"
    )
    parser.add_argument("--theme", choices=("system", "light", "dark"), default="system")


def run(args: argparse.Namespace) -> int:
    """Show the window until it is closed. Raises WrongUse where Qt cannot be loaded."""
    try:
        from gui.app import show

        return show(args.rig, args.theme)
    except ImportError as error:
        raise WrongUse(
            f"the window needs Qt, which does not load here ({error}): install PySide6-Essentials "
            "and, on Debian, libegl1 libgl1 libxkbcommon0 libdbus-1-3 libfontconfig1"
        ) from error
