"""Close the parts of a session whose writer was killed, and say what the session lacks.

HDF5 opens such a part with swmr=True only; afterwards every program opens it. Its rows stay what
they are. A part that is damaged or was cut short stays as it is: every command reads around it.
--resume of the command that made the session records the lost trials again.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from rigctl.cli.arguments import a_path, add_option
from rigctl.session.recover import recover


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    parser.add_argument(
        "--dry-run", action="store_true", help="only say what would be done, change nothing"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Close the killed parts and print a line for each, and for what is missing."""
    result = recover(args.session, dry_run=args.dry_run)
    if args.json:
        print(json.dumps({"dry_run": args.dry_run, **asdict(result)}, ensure_ascii=False))
        return 0
    done = "would be closed" if args.dry_run else "is closed"
    for name in result.closed:
        print(f"{name}: {done}, its writer was killed")
    for line in result.missing:
        print(f"note: {line}")
    if not result.closed:
        print(f"{args.session} has no part to close")
    return 0
