"""Check that a session or a bundle is whole, or name what is wrong.

Read every part and compare its digests, counts and plan; change nothing. Of a bundle, every file is
compared with its checksum, too. With the closing digest
that was kept elsewhere it also finds a session that was replaced as a whole. Exit code 0: whole; 1:
not whole; 2: not a session.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine, remaining
from rigctl.session.session import describe_missing
from rigctl.session.session_reader import read_closing_digest
from rigctl.session.verify import VerifyReport, parse_digest, verify


def print_session(folder: Path) -> None:
    """Print a session's folder and, if it is closed, its closing digest."""
    print(f"session: {folder}")
    if digest := read_closing_digest(folder):
        print(f"digest: {digest} (keep this line: `rigctl verify` compares it with --digest)")


def print_missing(folder: Path) -> None:
    """Print a note on each missing part and on trials that are left out, on standard error."""
    for line in describe_missing(folder):
        print(f"note: {folder}: {line}", file=sys.stderr, flush=True)


WHOLE, NOT_WHOLE = 0, 1
METADATA = "ro-crate-metadata.json"
QUIET_S = 2.0
"""A shorter check shows no progress."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    parser.add_argument(
        "--digest",
        type=parse_digest,
        metavar="HEX",
        help="the closing digest as it was printed when the session was closed",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print one line for each finding, then the answer."""
    line = ProgressLine(sys.stderr)
    if (args.session / METADATA).is_file():
        return _verify_bundle(args, line)

    def show(share: float, what: str) -> None:
        if share and line.elapsed_s > QUIET_S:
            line.show(f"{what}, {remaining(line.elapsed_s, share)} left")

    report = verify(args.session, show, args.digest or "")
    line.end()
    if args.json:
        print(json.dumps({"whole": report.whole, **asdict(report)}, ensure_ascii=False))
    else:
        _print(report, args.session)
    return WHOLE if report.whole else NOT_WHOLE


def _verify_bundle(args: argparse.Namespace, line: ProgressLine) -> int:
    """Print what a bundle lacks, then the answer and the digest of its description."""
    from rigctl.exchange.bundle import bundle_digest, verify_bundle

    problems = verify_bundle(args.session, line.show_stage)
    line.end()
    digest = bundle_digest(args.session)
    if args.digest and args.digest != digest:
        problems.append(f"{METADATA}: its digest is {digest}, not {args.digest}")
    if args.json:
        print(json.dumps({"whole": not problems, "problems": problems, "digest": digest}))
        return NOT_WHOLE if problems else WHOLE
    for problem in problems:
        print(f"problem: {problem}")
    n = len(problems)
    verdict = f"not whole, {n} problem{'s' * (n > 1)}" if n else "whole"
    print(f"{args.session} is a bundle and is {verdict}")
    print(f"digest: {digest}")
    return NOT_WHOLE if problems else WHOLE


def _print(report: VerifyReport, path: Path) -> None:
    for line in report.lines():
        print(line)
    print(report.answer(path))
    if report.closing_digest:
        print(f"digest: {report.closing_digest}")
