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


def main(wanted: list[str]) -> None:
    """Write the figures to :data:`OUTPUT` and print them."""
    OUTPUT.parent.mkdir(exist_ok=True)
    with OUTPUT.open("w") as output:
        for row in rows(wanted):
            line = json.dumps(row)
            print(line, flush=True)
            output.write(line + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
