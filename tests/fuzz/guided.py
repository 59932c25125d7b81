"""Mutations that a coverage-guided fuzzer (atheris, libFuzzer) chooses, for what Python parses.

``python -m tests.fuzz.guided KIND SECONDS SEED PLACE RESULTS`` works on one kind in its own
process, in the folder PLACE, and writes what it found to RESULTS as JSON lines. It needs atheris:
``make fuzz`` installs it apart from the environment of the program.
"""

from __future__ import annotations

import json
import sys
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import Any

import atheris

with atheris.instrument_imports(include=["rigctl"], enable_loader_override=False):
    from tests.fuzz.kinds.every_kind import KINDS
    from tests.fuzz.worker import Worker

MAX_BYTES = 20_000
SEEDS = 40
COUNTED = 100


def main() -> None:
    """Fuzz one kind until its time is over."""
    name, seconds, seed, place, results = sys.argv[1:6]
    warnings.simplefilter("error")
    kind = KINDS[name]
    worker = Worker(kind, Path(place) / "work", int(seed))
    worker.prepare(limited=False)
    corpus = Path(place) / "corpus"
    corpus.mkdir()
    for number in range(SEEDS):
        (corpus / str(number)).write_bytes(worker.seed_bytes(number)[:MAX_BYTES])
    seen: set[tuple[str, str]] = set()

    tried = 0

    def try_bytes(data: bytes) -> None:
        nonlocal tried
        tried += 1
        if tried % COUNTED == 0:
            (Path(place) / "count.txt").write_text(str(tried))
        for finding in worker.judge_bytes(data):
            if (finding.failure, finding.where) not in seen:
                seen.add((finding.failure, finding.where))
                _save(Path(results), data, asdict(finding))

    options = (f"-max_total_time={seconds}", f"-seed={seed}", f"-max_len={MAX_BYTES}")
    alone = ("-handle_alrm=0", "-timeout=0", "-rss_limit_mb=0", "-verbosity=0", "-close_fd_mask=3")
    atheris.Setup(["fuzz", *options, *alone, str(corpus)], try_bytes)
    atheris.Fuzz()


def _save(results: Path, data: bytes, finding: dict[str, Any]) -> None:
    with results.open("a", encoding="utf-8") as file:
        line = json.dumps({"data": data.hex(), **finding}, ensure_ascii=True)
        file.write(f"{line}\n")


if __name__ == "__main__":
    main()
