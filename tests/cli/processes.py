"""``rigctl`` as a process, and a protocol of one trial."""

from __future__ import annotations

import subprocess
import sys

ONE = """
name = "one"
textures = ["A"]
speeds_mm_s = [120]
forces_g = [500]
repeats = 1
"""
LIMIT_S = 120


def rigctl(*args: str) -> list[str]:
    """Return the command line."""
    return [sys.executable, "-m", "rigctl", *args]


def finished(*args: str) -> subprocess.CompletedProcess[str]:
    """Run a command without a terminal to its end."""
    return subprocess.run(
        rigctl(*args), capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=LIMIT_S
    )
