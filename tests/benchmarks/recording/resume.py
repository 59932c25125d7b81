"""Benchmark what a resume reads: a session of 300 parts, each left by a killed writer."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from rigctl.session.layout import part_name
from tests.session.building import SyntheticRig, plan, recorder

N_PARTS, ROUNDS = 300, 5
MOST_MB = 100.0
READ = """
import json, resource, sys, time
from pathlib import Path
from rigctl.session.recorder import read_history
one, all_parts = map(Path, sys.argv[1:])
read_history(one)  # loads the program
mb = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
before_s, before_mb = time.process_time(), mb()
read_history(all_parts)
print(json.dumps([time.process_time() - before_s, mb() - before_mb]))
"""
SPEED_NOTE = f"{N_PARTS} parts of killed writers read for a resume, processor time, median of 5"
MEMORY_NOTE = f"memory that the {N_PARTS} parts took beyond that of one"


def measure() -> Iterator[dict[str, Any]]:
    """Yield ``resume.read_s`` and ``resume.read_mb``."""
    with TemporaryDirectory() as name:
        one, all_parts = Path(name) / "one", Path(name) / "all"
        _record_killed(Path(name) / "scratch", one, 1)
        _record_killed(Path(name) / "scratch", all_parts, N_PARTS)
        words = [sys.executable, "-c", READ, str(one), str(all_parts)]
        rounds = [json.loads(subprocess.check_output(words)) for _ in range(ROUNDS)]
    read_s, read_mb = (round(median(values), 2) for values in zip(*rounds, strict=True))
    yield {"name": "resume.read_s", "value": read_s, "unit": "s", "note": SPEED_NOTE}
    yield {
        "name": "resume.read_mb",
        "value": read_mb,
        "unit": "MB",
        "limit": MOST_MB,
        "note": MEMORY_NOTE,
    }


def _record_killed(scratch: Path, folder: Path, n_parts: int) -> None:
    """Record a trial in each part; keep each as it is before its writer closes it."""
    folder.mkdir()
    with recorder(scratch) as rec:
        bench = SyntheticRig(rec)
        for number in range(n_parts):
            rec.begin_part("resume", "A")
            bench.trial(plan().trials[0], attempt=number + 1)
            rec.wait_written()
            shutil.copy(scratch / part_name(rec.status.part), folder)
    shutil.rmtree(scratch)
