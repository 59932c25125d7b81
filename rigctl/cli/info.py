"""Summarise a session.

Show protocol, rig, firmware, people, trials and samples as the session's own files say them;
`rigctl verify` checks them.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

from rigctl.cli.arguments import a_path, add_option
from rigctl.session.summary import summarise_session


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "session", a_path, help_text="a session's folder")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the summary. Raises SessionError for a folder that is not a session."""
    summary = summarise_session(args.session)
    if args.json:
        print(json.dumps(summary, ensure_ascii=False))
        return 0
    width = max(map(len, summary))
    for name, value in summary.items():
        print(f"{name.replace('_', ' '):<{width}}  {_format(value)}")
    return 0


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
