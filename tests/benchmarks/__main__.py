"""Run all benchmarks or the named ones, print one JSON object per line, and write build/."""

from __future__ import annotations

import json
import pkgutil
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import tests.benchmarks

OUTPUT = Path("build/bench.jsonl")


def rows(wanted: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the figures of the wanted modules; an empty list means all modules."""
    packages = pkgutil.walk_packages(tests.benchmarks.__path__, "tests.benchmarks.")
    for module in sorted((m.name for m in packages), key=_last):
        if _last(module).startswith("_") or (wanted and _last(module) not in wanted):
            continue
        measured = import_module(module)
        if hasattr(measured, "measure"):
            yield from measured.measure()


def _last(module: str) -> str:
    return module.rpartition(".")[2]


def main(wanted: list[str]) -> int:
    """Write the figures to :data:`OUTPUT`, print them, and return 1 where one is over its limit."""
    OUTPUT.parent.mkdir(exist_ok=True)
    over = []
    with OUTPUT.open("w") as output:
        for row in rows(wanted):
            line = json.dumps(row)
            print(line, flush=True)
            output.write(line + "\n")
            if row.get("limit") is not None and row["value"] > row["limit"]:
                over.append(f"{row['name']} is {row['value']}, its limit {row['limit']}")
    for sentence in over:
        print(sentence, file=sys.stderr)
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
