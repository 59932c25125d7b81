"""Run every measurement (or those named), print one JSON object a line, keep them in build/."""

from __future__ import annotations

import json
import pkgutil
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import tests.bench

OUTPUT = Path("build/bench.jsonl")


def rows(wanted: list[str]) -> Iterator[dict[str, Any]]:
    """Figures of every module in this folder whose name is wanted (all when none is named)."""
    for module in sorted(m.name for m in pkgutil.iter_modules(tests.bench.__path__)):
        if module.startswith("_") or (wanted and module not in wanted):
            continue
        measured = import_module(f"tests.bench.{module}")
        if hasattr(measured, "measure"):
            yield from measured.measure()


def main(wanted: list[str]) -> None:
    OUTPUT.parent.mkdir(exist_ok=True)
    with OUTPUT.open("w") as output:
        for row in rows(wanted):
            line = json.dumps(row)
            print(line, flush=True)
            output.write(line + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
