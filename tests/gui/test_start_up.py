"""The window opens without the modules that it does not show."""

from __future__ import annotations

import subprocess
import sys

LOADED = """
import sys
import gui.shell.main_window
print(*sorted({name.partition(".")[0] for name in sys.modules}))
"""
HEAVY = {"dask", "h5py", "matplotlib", "numba", "pandas", "scipy", "sklearn"}


def test_the_window_loads_no_compiler_and_no_statistics() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOADED], capture_output=True, text=True, check=True
    )
    loaded = set(done.stdout.split())
    assert "pyqtgraph" in loaded
    assert not HEAVY & loaded
