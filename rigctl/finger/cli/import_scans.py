"""Make a session of the moving finger from recordings of another program."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime

from rigctl.cli.arguments import a_path, add_option
from rigctl.finger.recordings import import_scans


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    add_option(
        parser, "list", a_path, "LIST.csv", "scans: file, texture, stage and, if known, profile"
    )
    add_option(parser, "--out", a_path, "DIR", "folder of the new session", required=True)
    parser.add_argument(
        "--sensor",
        default="imported",
        type=str.strip,
        help="name of the sensor, the same for all its sessions",
    )


def run(args: argparse.Namespace) -> int:
    """Import the scans; the last line names the session."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    print("\n".join(import_scans(args.list, args.out, args.sensor, now)))
    print(f"session: {args.out}")
    return 0
