"""A guessed map: written to a new file, with ten rows and what each column seems to be."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path

from rigctl.config.names import shorten
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
