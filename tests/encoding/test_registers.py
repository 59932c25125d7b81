"""The kernel with vectors for registers that this processor may not have."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_other_registers_give_the_same_spikes(tmp_path: Path) -> None:
    def digest(*which: str) -> list[str]:
        command = [sys.executable, "-m", "tests.encoding.other_registers", *which]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "".join(which))}
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        return ran.stdout.split()

    (width, spikes), (other_width, other_spikes) = digest(), digest("other")
    assert {width, other_width} == {"4", "8"}
    assert spikes == other_spikes
