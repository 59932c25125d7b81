"""Import recordings from elsewhere into a session.

Each trial of the files becomes a trial of 1 kHz samples. The map names the columns and says where
the labels are; --guess looks at the files and writes such a map. Reads .csv, .tsv, .txt, .lvm,
.mat, .npy, .npz and .nwb, and all of these in a folder.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path

from rigctl.analysis.notes import summarise_notes
from rigctl.cli import INTERRUPTED
from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import Interrupts, ProgressLine
from rigctl.cli.verify import print_session
from rigctl.config.text_file import shorten
from rigctl.errors import DiskFault, WrongUse
from rigctl.exchange.guess import GuessedMap

WIDTH = 100
CELL, NAME = 16, 32


def write_guess(path: Path, guessed: GuessedMap) -> None:
    """Write the map. Raises WrongUse for a file that exists, and DiskFault."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(guessed.text)
    except FileExistsError as error:
        raise WrongUse(f"{path} exists already: name another file with --map") from error
    except OSError as error:
        raise DiskFault(f"{path} cannot be written ({error.strerror})") from error


def print_guess(path: Path, files: Sequence[Path], guessed: GuessedMap, *, as_json: bool) -> None:
    """Print rows, columns and labels, and why the map does not work yet."""
    if as_json:
        answer = {
            "map": str(path),
            "files": len(files),
            "columns": [dict(zip(("name", "role"), pair, strict=True)) for pair in guessed.columns],
            "labels": dict(guessed.labels),
            "trials_of_first_file": guessed.n_trials,
            "assumed": [words for _, words in find_assumptions(guessed.text)],
            "problem": guessed.problem,
        }
        print(json.dumps(answer, ensure_ascii=False))
        return
    count = "1 file" if len(files) == 1 else f"{len(files)} files"
    print(f"{count}; the first rows of {files[0]}:\n")
    print_table([guessed.header, *guessed.rows])
    print("\nEach column seems to be:\n")
    print_pairs([*guessed.columns, *((f"({label})", words) for label, words in guessed.labels)])
    if guessed.n_trials:
        print(f"\nTrials in this file: {guessed.n_trials}")
    if assumed := find_assumptions(guessed.text):
        print("\nNothing in the files says these; read them:\n")
        print_pairs(assumed)
    print(f"\nMap: {path}")
    if guessed.problem:
        print(f"note: the map does not work yet: {guessed.problem}", file=sys.stderr)


def find_assumptions(text: str) -> list[tuple[str, str]]:
    """Return the lines of a map that say that something is assumed, each with its place."""
    lines = enumerate(text.splitlines(), 1)
    return [(f"line {n}", line.lstrip("# ")) for n, line in lines if "assumed" in line.lower()]


def print_table(rows: Sequence[Sequence[str]]) -> None:
    """Print rows in columns, as many as fit into 100 letters."""
    widths = [max(len(shorten(row[k], CELL)) for row in rows) + 2 for k in range(len(rows[0]))]
    shown = sum(1 for total in accumulate(widths) if total <= WIDTH)
    for row in rows:
        cells = [shorten(row[k], CELL).ljust(widths[k]) for k in range(shown)]
        print("  " + "".join(cells).rstrip() + (" …" if shown < len(widths) else ""))


def print_pairs(pairs: Sequence[tuple[str, str]]) -> None:
    """Print names and what is said of each, one below the other."""
    width = max(len(shorten(name, NAME)) for name, _ in pairs) + 2
    for name, words in pairs:
        print(f"  {shorten(name, NAME).ljust(width)}{shorten(words, WIDTH)}")


LINES_SHOWN = 30
GUESSED = Path("map.toml")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_option(parser, "files", a_path, "FILE", "a recording, or a folder", nargs="+")
    parser.add_argument(
        "--guess", action="store_true", help="write a map for these files; import nothing"
    )
    add_option(
        parser,
        "--map",
        a_path,
        "MAP",
        f"a TOML file; with --guess the new one (default: {GUESSED})",
    )
    add_option(parser, "--out", a_path, "DIR", "the new session")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Import the files, or guess their map; return 0 when all went well."""
    from rigctl.exchange.recording_files import find_recordings

    if not args.guess and (args.map is None or args.out is None):
        raise WrongUse("an import needs --map and --out; --guess writes a map")
    files, left_out = find_recordings(args.files)
    if left_out:
        names = f"{left_out[0].name}{' and more' if len(left_out) > 1 else ''}"
        print(
            f"note: {len(left_out)} files of the folder are of another kind than {files[0].name}: "
            f"left out ({names})",
            file=sys.stderr,
        )
    return _guess(args, files) if args.guess else _import(args, files)


def _guess(args: argparse.Namespace, files: list[Path]) -> int:
    """Write the guessed map; return 1 if it does not work yet."""
    from rigctl.exchange.guess import guess_map

    if args.out is not None:
        raise WrongUse("--guess imports nothing: leave out --out")
    path = args.map or GUESSED
    if path.exists():
        raise WrongUse(f"{path} exists already: name another file with --map, or delete it")
    guessed = guess_map(files)
    write_guess(path, guessed)
    print_guess(path, files, guessed, as_json=args.json)
    return 1 if guessed.problem else 0


def _import(args: argparse.Namespace, files: list[Path]) -> int:
    """Import the files and return 0 when all are in the session; check all before writing any."""
    from rigctl.exchange.column_map import load_map
    from rigctl.exchange.importer import import_files

    line = ProgressLine(sys.stderr, quiet=args.json)

    def show(stage: str, done: int) -> None:
        line.show_stage(f"{stage} files", done, len(files))

    stamp = datetime.now(UTC).isoformat(timespec="seconds")
    with Interrupts(limit=1) as interrupts:
        surveyed, whole = import_files(
            files, load_map(args.map), args.out, stamp, show, interrupts.requested
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
    """Print the last remarks, which are about all files; several of one kind are one line."""
    notes = summarise_notes(lines, rest_in="the session")
    shown = notes[-LINES_SHOWN:]
    if len(shown) < len(notes):
        left = len(notes) - len(shown)
        print(f"note: the session's events contain {left} more remarks", file=sys.stderr)
    for line in shown:
        print(f"note: {line}", file=sys.stderr)
