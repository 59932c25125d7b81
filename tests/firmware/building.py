"""Build the images that the tests run, safely from several test processes."""

from __future__ import annotations

import fcntl
import subprocess
from functools import cache
from pathlib import Path

from rigctl.config.resources import checkout


@cache
def built(target: str) -> Path:
    """Build a target of ``arduino/Makefile``; return its path under ``build/``."""
    root = checkout()
    assert root is not None
    path = root / "build" / target
    path.parent.mkdir(parents=True, exist_ok=True)
    with (root / "build" / ".firmware-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-s", "-C", str(root / "arduino"), f"../build/{target}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return path
