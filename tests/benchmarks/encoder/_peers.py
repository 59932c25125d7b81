"""Run a script of this folder in the peers' Python environment and read its result."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

ABSENT = "no peers environment: make bench builds it and sets RIGCTL_PEERS_PYTHON"


def available() -> bool:
    """Return whether there is a peers' environment."""
    return Path(os.environ.get("RIGCTL_PEERS_PYTHON", "")).is_file()


def run_script(script: str, *arguments: str, threads: int = 1) -> dict[str, Any]:
    """Run ``script`` with the peers' Python; return the JSON object of its last line."""
    python = os.environ["RIGCTL_PEERS_PYTHON"]
    path = str(Path(__file__).with_name(script))
    limits = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [python, path, *arguments], capture_output=True, text=True, env={**os.environ, **limits}
    )
    if done.returncode:
        raise RuntimeError(f"{script} {' '.join(arguments)}: {done.stderr.strip()[-800:]}")
    answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


def row(
    name: str, value: float, unit: str, peer: str, peer_value: float | None, note: str
) -> dict[str, Any]:
    """Return one figure; ``ratio`` is the peer's value over ours."""
    ratio = peer_value / value if peer_value is not None and value else None
    return {
        "name": name,
        "value": value,
        "unit": unit,
        "peer": peer,
        "peer_value": peer_value,
        "ratio": ratio,
        "note": note,
    }
