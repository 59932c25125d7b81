"""``make fuzz``: mutated files of every kind, then requests to both engines.

``FUZZ_SEED``, ``FUZZ_FILES`` (of each kind), ``FUZZ_REQUESTS`` and ``FUZZ_KINDS`` (names, separated
by spaces) come from the environment. Exit code 1: something was found.
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
from tests.fuzz.kinds.every_kind import KINDS
from tests.fuzz.worker import Worker

FILES = 5000
RESULTS = Path("build/fuzz").absolute()


def main() -> int:
    """Run the campaign that the environment describes."""
    seed = int(os.environ.get("FUZZ_SEED") or secrets.randbelow(2**32))
    files = int(os.environ.get("FUZZ_FILES") or FILES)
    kinds = (os.environ.get("FUZZ_KINDS") or " ".join(KINDS)).split()
    processes = int(os.environ.get("FUZZ_PROCESSES") or os.cpu_count() or 1)
    print(f"seed {seed}: FUZZ_SEED={seed} repeats this run", flush=True)
    workplace = Path(tempfile.mkdtemp(prefix="fuzz-", dir=_fast_place()))
    try:
        campaign = Campaign(workplace, RESULTS / "findings", seed)
        campaign.run(files, kinds, processes)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
    print(campaign.report())
    return 1 if campaign.causes else 0


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


def _fast_place() -> str | None:
    memory = Path("/dev/shm")
    return str(memory) if os.access(memory, os.W_OK) else None


if __name__ == "__main__":
    sys.exit(again(Path(sys.argv[1])) if sys.argv[1:] else main())
