"""``rigctl calibrate sensor``: measure how each taxel answers to the force on the smooth plate."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine
from rigctl.cli.run import EXIT_CODES, watch_run
from rigctl.encoder.reading import Reading
from rigctl.engine.rpc.client import EngineClient
from rigctl.errors import WrongUse

PROTOCOL = "sensor"
IMPLAUSIBLE = 2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    add_option(
        parser, "--session", a_path, "DIR", f"measure a session of the protocol {PROTOCOL} again"
    )
    add_option(parser, "--out", a_path, "DIR", "new folder of the report (default: SESSION-report)")
    parser.add_argument(
        "--reading",
        type=Reading,
        choices=list(Reading),
        default=Reading.CONDUCTANCE,
        help="what a taxel's curve is of (conductance)",
    )


def run(args: argparse.Namespace) -> int:
    """Record the protocol unless a session is given; print the result and write the report."""
    from rigctl.analysis.sensor_response import as_dict, measure, summary_lines, write_report

    if args.session is not None and args.out is not None and args.out.exists():
        raise WrongUse(f"{args.out} already exists: name another folder")
    session = args.session
    if session is None:
        state, session = _record(args)
        if state != "done":
            return EXIT_CODES[state]
    found = measure(session, args.reading)
    page = write_report(found, args.out or session.with_name(f"{session.name}-report"))
    if args.json:
        print(json.dumps(as_dict(found) | {"report": str(page)}, ensure_ascii=False))
    else:
        print("\n".join([*summary_lines(found), f"session: {session}", f"report: {page}"]))
    return IMPLAUSIBLE if found.findings else 0


def _record(args: argparse.Namespace) -> tuple[str, Path]:
    """Run the protocol on the rig; return how the run ended, and the session."""
    arguments = [f"--protocol={PROTOCOL}", *(["--yes"] if args.yes else [])]
    if args.world is not None:
        arguments.append(f"--world={args.world}")
    client = EngineClient.start(args.rig, paced=False, seed=args.seed, run=arguments)
    ended = watch_run(client, ProgressLine(sys.stderr, quiet=args.json))
    return ended.state, Path(str(ended.session))
