"""Import recordings from elsewhere into a session.

Each file becomes a trial of 1 kHz samples, labelled by its name. The map names the columns.
Reads .csv, .tsv, .txt, .mat, .npy and .npz.
"""

from __future__ import annotations

import argparse
import json
import sys
from datetime import UTC, datetime

from rigctl.cli import INTERRUPTED
from rigctl.cli.data.closing import print_session
from rigctl.cli.options.arguments import a_path
from rigctl.cli.options.progress import ProgressLine
from rigctl.cli.options.terminal import Interrupts

LINES_SHOWN = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("files", nargs="+", type=a_path("FILE"), metavar="FILE")
    parser.add_argument(
        "--map", required=True, type=a_path("--map"), metavar="MAP", help="a TOML file"
    )
    parser.add_argument(
        "--out", required=True, type=a_path("--out"), metavar="DIR", help="the new session"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Import the files and return 0 when all are in the session; check all before writing any."""
    from rigctl.exchange.column_map import load_map
    from rigctl.exchange.importer import import_files

    line = ProgressLine(sys.stderr, quiet=args.json)

    def show(stage: str, done: int) -> None:
        line.show_stage(f"{stage} files", done, len(args.files))

    stamp = datetime.now(UTC).isoformat(timespec="seconds")
    with Interrupts(limit=1) as interrupts:
        surveyed, whole = import_files(
            args.files, load_map(args.map), args.out, stamp, show, interrupts.requested
        )
    if args.json:
        answer = {"session": str(args.out), "trials": len(surveyed.trials), "whole": whole}
        print(json.dumps(answer | {"report": list(surveyed.remarks)}, ensure_ascii=False))
        return 0 if whole else INTERRUPTED
    _show(surveyed.remarks)
    if not whole:
        print("rigctl: interrupted; the session holds the files written so far", file=sys.stderr)
        return INTERRUPTED
    print(f"{len(surveyed.trials)} trials of {len(surveyed.scaling.names)} taxels")
    print_session(args.out)
    return 0


def _show(lines: tuple[str, ...]) -> None:
    """Print the last remarks: those are about all files."""
    shown = lines[-LINES_SHOWN:]
    if len(shown) < len(lines):
        left = len(lines) - len(shown)
        print(f"note: the session's events contain {left} more remarks", file=sys.stderr)
    for line in shown:
        print(f"note: {line}", file=sys.stderr)
