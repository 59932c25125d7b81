"""Judge the trials of a session on their data, and draw a page of it.

Each trial is compared with the equal trials before it: dead, stuck, saturated and noisy taxels,
drift of the lifted readings, noise and spikes of the load cell, and what is unusual. The session
stays as it is. Exit code 0: every planned trial has a good attempt; 1: one has none.
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import partial
from pathlib import Path

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ProgressLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    add_option(parser, "--out", a_path, "DIR", "new folder of the page (beside the session)")
    parser.add_argument("--json", action="store_true", help="print the verdicts as JSON")


def run(args: argparse.Namespace) -> int:
    """Print the verdicts and the path of the page; return 1 where a trial is given up."""
    from rigctl.analysis.session_quality import (
        as_dict,
        judge_session,
        summary_lines,
        write_quality,
    )
    from rigctl.session.data_quality import GIVEN_UP

    line = ProgressLine(sys.stderr)
    found = judge_session(args.session, partial(line.show_stage, "trials"))
    line.end()
    session: Path = args.session
    page = write_quality(found, args.out or session.with_name(f"{session.name}-quality"))
    if args.json:
        print(json.dumps(as_dict(found), ensure_ascii=False, allow_nan=False))
    else:
        print("\n".join([*summary_lines(found), f"page: {page}"]))
    return int(found.counts()[GIVEN_UP] > 0)
