"""Put a crashed or damaged session in order.

Close killed parts, save what can be read of damaged ones, and move what is no part of the session
away. Every original stays as it is, in the folder quarantine of the session; a dated recovery file
says what was saved and what was not. After it, verify calls the session whole, and --resume of the
command that made it records the lost trials again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from datetime import UTC, datetime

from rigctl.cli.options.arguments import a_path
from rigctl.session.recover.recover import PartOutcome, RecoveryResult, recover

MAX_LISTED = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("session", type=a_path("SESSION"), help="a session's folder")
    parser.add_argument(
        "--dry-run", action="store_true", help="only say what would be done, change nothing"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Put the session in order and print a table of what was saved and what was not."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    result = recover(args.session, now, dry_run=args.dry_run)
    if args.json:
        print(json.dumps(_as_dict(result, args.dry_run), ensure_ascii=False))
    else:
        print("\n".join([*_lines(result), _verdict(result, args)]))
    return 0


def _lines(result: RecoveryResult) -> Iterator[str]:
    for record in result.finished:
        yield f"an interrupted recovery is finished: {record.path}"
    for part in result.parts:
        yield f"{part.name}: {part.remedy}; it {part.reason}"
        yield from _table(part)
    for stray in result.strays:
        yield f"{stray.path.name}: moved away; it {stray.reason}"
    if result.findings.lines_problem:
        yield f"digests.txt: written anew from the parts; it {result.findings.lines_problem}"
    for rows in result.findings.damaged_rows:
        last = rows.first_row + rows.n_rows - 1
        yield f"part {rows.part}: altered, rows {rows.first_row} to {last} of {rows.table}"
    for trial in result.findings.left_out:
        yield f"part {trial.part}: trial {trial.trial_id} is left out; {trial.reason}"
    if result.not_committed:
        yield f"planned trials that are not committed: {_list(result.not_committed)}"


def _table(part: PartOutcome) -> Iterator[str]:
    """Yield a line for each data set of a part that was saved, and one for its trials."""
    if not part.rows:
        return
    yield f"  {'rows of':<18}{'stored':>12}{'saved':>12}{'proved':>12}"
    for path, rows in part.rows.items():
        yield f"  {path:<18}{rows.stored:>12,}{rows.saved:>12,}{rows.proved:>12,}"
    listed = [f"{trial}" if n == 1 else f"{trial} (attempt {n})" for trial, n in part.attempts]
    yield f"  attempts saved at the trials {_list(listed) or '–'}"


def _list(values: tuple[int, ...] | list[str]) -> str:
    listed = ", ".join(map(str, values[:MAX_LISTED]))
    return f"{listed} … ({len(values)})" if len(values) > MAX_LISTED else listed


def _verdict(result: RecoveryResult, args: argparse.Namespace) -> str:
    if result.findings.is_in_order:
        return f"{args.session} is in order, there is nothing to recover"
    if result.record is None:
        return "nothing was changed: leave out --dry-run to do this"
    return f"recovery file: {result.record.path}"


def _as_dict(result: RecoveryResult, dry_run: bool) -> dict[str, object]:
    return {
        "dry_run": dry_run,
        "in_order": result.findings.is_in_order,
        "parts": [
            {"name": part.name, "remedy": part.remedy, "reason": part.reason}
            for part in result.parts
        ],
        "moved": [stray.path.name for stray in result.strays],
        "not_committed": list(result.not_committed),
        "finished": [str(record.path) for record in result.finished],
        "recovery_file": None if result.record is None else str(result.record.path),
    }
