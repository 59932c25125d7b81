"""Run all benchmarks or the named ones, print one JSON object per line, and write build/."""

from __future__ import annotations

import json
import pkgutil
import sys
import traceback
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import TextIO

import tests.benchmarks

OUTPUT = Path("build/bench.jsonl")


def groups(wanted: list[str]) -> Iterator[str]:
    """Yield the wanted modules; an empty list means all modules."""
    packages = pkgutil.walk_packages(tests.benchmarks.__path__, "tests.benchmarks.")
    for module in sorted((m.name for m in packages), key=_last):
        if not _last(module).startswith(("_", "test_")) and (not wanted or _last(module) in wanted):
            yield module


def _last(module: str) -> str:
    return module.rpartition(".")[2]


def main(wanted: list[str]) -> int:
    """Write the figures to :data:`OUTPUT` and print them.

    Returns 1 where a figure is over its limit or a group has failed; the others are measured.
    """
    OUTPUT.parent.mkdir(exist_ok=True)
    complaints = []
    with OUTPUT.open("w") as output:
        for module in groups(wanted):
            try:
                complaints += _measure(module, output)
            except Exception as error:  # noqa: BLE001 - top of a group: the next one is measured
                traceback.print_exc()
                complaints.append(f"{_last(module)} failed: {error}")
    for sentence in complaints:
        print(sentence, file=sys.stderr)
    return 1 if complaints else 0


def _measure(module: str, output: TextIO) -> list[str]:
    """Write and print the figures of a module; return a sentence on each over its limit."""
    measured, over = import_module(module), []
    for row in measured.measure() if hasattr(measured, "measure") else ():
        line = json.dumps(row)
        print(line, flush=True)
        output.write(line + "\n")
        if row.get("limit") is not None and row["value"] > row["limit"]:
            over.append(f"{row['name']} is {row['value']}, its limit {row['limit']}")
    return over


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
