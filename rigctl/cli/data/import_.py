"""``rigctl import --map MAP.toml FILES… --out DIR``: recordings from elsewhere into a session."""

from __future__ import annotations

import argparse
import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.cli import INTERRUPTED
from rigctl.cli.options.interrupt import Interrupt
from rigctl.cli.options.progress import clock

TELL_EVERY_S = 2.0
LINES_SHOWN = 30


def add_parser(subparsers: Any) -> None:
    """Describe the command line."""
    parser = subparsers.add_parser(
        "import",
        help="bring recordings from elsewhere into a session",
        description="Each file becomes a trial of 1 kHz samples, labelled by its name. The map "
        "says which column is what. Reads .csv, .tsv, .txt, .mat, .npy and .npz.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--map", required=True, type=Path, metavar="MAP", help="a TOML file")
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="the new session")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Import; 0 when all files are in the session. Refuses before anything is written."""
    from rigctl.exchange.column_map import load_map
    from rigctl.exchange.importer import import_files

    teller = ImportProgress(len(args.files), quiet=args.json)
    stamp = datetime.now(UTC).isoformat(timespec="seconds")
    with Interrupt() as interrupt:
        surveyed, whole = import_files(
            args.files, load_map(args.map), args.out, stamp, teller.tell, interrupt.asked
        )
    if args.json:
        answer = {"session": str(args.out), "trials": len(surveyed.files), "whole": whole}
        print(json.dumps(answer | {"report": list(surveyed.remarks)}, ensure_ascii=False))
        return 0 if whole else INTERRUPTED
    _show(surveyed.remarks)
    if not whole:
        print("rigctl: interrupted; the session holds what was written", file=sys.stderr)
        return INTERRUPTED
    print(f"{len(surveyed.files)} trials of {len(surveyed.scaling.names)} taxels")
    print(f"session: {args.out}")
    return 0


def _show(lines: tuple[str, ...]) -> None:
    """The last lines speak of all files, so they are shown whatever is left out."""
    shown = lines[-LINES_SHOWN:]
    if len(shown) < len(lines):
        left = len(lines) - len(shown)
        print(f"note: {left} more lines stand in the session's events", file=sys.stderr)
    for line in shown:
        print(f"note: {line}", file=sys.stderr)


class ImportProgress:
    """A line now and then for imports that last."""

    def __init__(self, files: int, quiet: bool) -> None:
        self._files = files
        self._quiet = quiet
        self._what = ""
        self._began_s = self._told_s = 0.0

    def tell(self, what: str, done: int) -> None:
        """``done`` files are looked at, or written."""
        now_s = time.monotonic()
        if what != self._what:
            self._what, self._began_s, self._told_s = what, now_s, now_s
        if self._quiet or not done or now_s - self._told_s < TELL_EVERY_S:
            return
        self._told_s = now_s
        left_s = (now_s - self._began_s) / done * (self._files - done)
        print(f"{what} {done}/{self._files} files · {clock(left_s)} left", file=sys.stderr)
