"""``rigctl gui``: open the window."""

from __future__ import annotations

import argparse
from typing import Any

from gui.app import DESCRIPTION, add_arguments, show


def add_parser(subparsers: Any) -> None:
    """Add the command; Qt is imported only when it runs."""
    parser = subparsers.add_parser("gui", help="open the window", description=DESCRIPTION)
    add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Show the window until it is closed. Raises WrongUse where Qt has no display."""
    return show(args.rig, args.world, args.theme)
