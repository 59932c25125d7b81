"""Benchmark exports of 24,000 trials: processor time and the most memory of each format."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.benchmarks.recording.table import SET, ensure_set

FORMATS = {"nwb": "x.nwb", "matlab": "x.mat", "parquet": "x", "csv": "x", "neo": "x.nix"}
MOST_MIB = 1024.0
PROGRAM = """
import resource, sys
from rigctl.cli import main
main(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""
NOTE = "24,000 trials of 16 mm in 16 parts, whole: readings, drum, trials, events, spikes"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``export.*_mib``, the most memory in use, and ``export.*_s`` of a processor."""
    ensure_set()
    for name, target in FORMATS.items():
        with TemporaryDirectory(dir=SET.parent) as folder:
            seconds, most_mib = _export(name, Path(folder) / target)
        yield _row(f"export.{name}_mib", round(most_mib, 1), "MiB", MOST_MIB)
        yield _row(f"export.{name}_s", round(seconds, 1), "s", None)


def _export(name: str, target: Path) -> tuple[float, float]:
    words = ["export", str(SET), "--to", name, "--out", str(target)]
    command = [sys.executable, "-c", PROGRAM, *words]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=os.environ)
    seconds, most_mib = done.stdout.split()[-2:]
    return float(seconds), float(most_mib)


def _row(name: str, value: float, unit: str, limit: float | None) -> dict[str, Any]:
    return {
        "name": name,
        "value": value,
        "unit": unit,
        "peer": None,
        "peer_value": None,
        "ratio": None,
        "limit": limit,
        "note": NOTE,
    }
