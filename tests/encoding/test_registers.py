"""The kernel laid out for registers that this processor may not have."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_other_registers_give_the_same_spikes(tmp_path: Path) -> None:
    def told(*which: str) -> list[str]:
        command = [sys.executable, "-m", "tests.encoding.other_registers", *which]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "".join(which))}
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return ran.stdout.split()

    (wide, spikes), (other_wide, of_others) = told(), told("other")
    assert {wide, other_wide} == {"4", "8"}
    assert spikes == of_others
