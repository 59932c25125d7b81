"""``make fuzz``: mutated files of every kind, guided ones, and requests to both engines.

``FUZZ_SEED``, ``FUZZ_FILES`` (of each kind), ``FUZZ_REQUESTS`` (to each engine), ``FUZZ_SECONDS``
(of guided mutations of each kind that is text) and ``FUZZ_KINDS`` (names, separated by spaces) come
from the environment. Exit code 1: something was found.
``python -m tests.fuzz FOLDER`` judges one finding of ``build/fuzz/findings`` again.
"""

from __future__ import annotations

import os
import secrets
import shutil
import sys
import tempfile
from pathlib import Path

from tests.fuzz.campaign import Campaign
from tests.fuzz.guided_campaign import fuzz_guided
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.request_campaign import fuzz_requests
from tests.fuzz.worker import Worker

FILES, REQUESTS, SECONDS = 5000, 10_000, 60
RESULTS = Path("build/fuzz").absolute()


def main() -> int:
    """Run what the environment describes."""
    seed = _number("FUZZ_SEED", secrets.randbelow(2**32))
    kinds = (os.environ.get("FUZZ_KINDS") or " ".join(KINDS)).split()
    processes = _number("FUZZ_PROCESSES", os.cpu_count() or 1)
    print(f"seed {seed}: FUZZ_SEED={seed} repeats this run", flush=True)
    workplace = Path(tempfile.mkdtemp(prefix="fuzz-", dir=_fast_place()))
    shutil.rmtree(RESULTS / "findings", ignore_errors=True)
    try:
        campaign = Campaign(workplace / "files", RESULTS / "findings", seed)
        campaign.run(_number("FUZZ_FILES", FILES), kinds, processes)
        print(campaign.report(), flush=True)
        count = _number("FUZZ_REQUESTS", REQUESTS)
        answers = fuzz_requests(workplace / "requests", RESULTS / "findings", seed, count)
        print(answers.report, flush=True)
        seconds = _number("FUZZ_SECONDS", SECONDS)
        guided = fuzz_guided(workplace / "guided", RESULTS / "findings", seed, seconds, kinds)
        print(guided.report, flush=True)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
    return 1 if campaign.causes or answers.found or guided.found else 0


def again(finding: Path) -> int:
    """Judge a kept case again and print what goes wrong."""
    name = (finding / "report.txt").read_text(encoding="utf-8").split()[1].strip(",")
    with tempfile.TemporaryDirectory(prefix="fuzz-") as workplace:
        worker = Worker(KINDS[name], Path(workplace), 0)
        worker.prepare()
        case = worker.again(finding / "case")
    for found in case.findings:
        print(f"{found.failure}: {found.where}\n{found.details}")
    return 1 if case.findings else 0


def _number(name: str, default: int) -> int:
    return int(os.environ.get(name) or default)


def _fast_place() -> str | None:
    memory = Path("/dev/shm")
    return str(memory) if os.access(memory, os.W_OK) else None


if __name__ == "__main__":
    sys.exit(again(Path(sys.argv[1])) if sys.argv[1:] else main())
