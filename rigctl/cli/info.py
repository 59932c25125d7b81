"""Summarise a session, or list those below a folder.

Show protocol, rig, firmware, people, trials and samples as the session's own files say them;
`rigctl verify` checks them. A folder that holds sessions becomes a list, a line for each, the
newest first.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rigctl.analysis.files import atomic_file
from rigctl.cli.arguments import a_path, add_option
from rigctl.session.part import existing_parts
from rigctl.session.summary import find_sessions, read_line, summarise_session
from rigctl.session.trial_csv import write_trials
from rigctl.values import UNREADABLE, SessionLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(
        parser, "session", a_path, help_text="a session's folder, or one that holds sessions"
    )
    add_option(parser, "--csv", a_path, "FILE", "write all attempts with their notes as a table")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the summary. Raises SessionError for a folder that is not a session."""
    if args.csv is not None:
        with atomic_file(args.csv) as whole:
            write_trials(args.session, whole)
        print(args.csv)
        return 0
    if args.session.is_dir() and not existing_parts(args.session) and _list(args):
        return 0
    summary = summarise_session(args.session)
    if args.json:
        print(json.dumps(summary, ensure_ascii=False))
        return 0
    width = max(map(len, summary))
    for name, value in summary.items():
        print(f"{name.replace('_', ' '):<{width}}  {_format(value)}")
    return 0


def _list(args: argparse.Namespace) -> bool:
    """Print a line for each session below the folder; return whether there is one."""
    lines = list(map(read_line, find_sessions(args.session)))
    rows = [_row(line, args.session) for line in lines]
    if lines:
        print(json.dumps(list(map(asdict, lines))) if args.json else "\n".join(rows))
    return bool(lines)


def _row(line: SessionLine, folder: Path) -> str:
    trials = f"{line.trials_committed} of {line.trials_planned} trials"
    bad = f", {line.marked_bad} bad" if line.marked_bad else ""
    simulated = "simulated" if line.simulated else ""
    parts = (f"{trials}{bad}", line.state, simulated, line.operator, f"{line.bytes / 1e6:.1f} MB")
    about = line.reason if line.state == UNREADABLE else ", ".join(filter(None, parts))
    return f"{line.start_utc[:16]:16}  {Path(line.path).relative_to(folder)}: {about}"


def _format(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(
            f"{name.replace('_', ' ')} {_format(item)}" for name, item in value.items()
        )
    if isinstance(value, list):
        texts = list(map(_format, value))
        return ("; " if any(" " in text for text in texts) else " ").join(texts) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}"
    if value is None:
        return "–"
    return f"{value:,}" if isinstance(value, int) else str(value)
