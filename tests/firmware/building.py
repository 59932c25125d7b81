"""Build the images that the tests run, safely from several test processes."""

from __future__ import annotations

import fcntl
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from rigctl import host_build
from rigctl.config.resources import checkout
from tests.firmware.broken import BROKEN, edited_copy


@cache
def built(target: str) -> Path:
    """Build a target of ``arduino/Makefile``, or an image named in BROKEN; return its path."""
    board, _, name = Path(target).stem.partition("-")
    with _locked() as root:
        if name not in BROKEN.get(board, {}):
            return _make(root, target)
        folder = root / "build" / "broken" / f"{board}-{name}"
        edited_copy(root / "arduino", board, name, folder)
        return _make(folder, f"firmware/{board}.elf")


def host_library(board: str, name: str, output: Path) -> Path:
    """Compile a board that is named in BROKEN for this computer; return the path ``output``."""
    with _locked() as root:
        arduino = edited_copy(
            root / "arduino", board, name, root / "build" / "broken" / f"{board}-{name}"
        )
        return host_build.build(board, output, arduino=arduino)


@contextmanager
def _locked() -> Iterator[Path]:
    """Yield the checkout while no other process builds in it."""
    root = checkout()
    assert root is not None
    (root / "build").mkdir(exist_ok=True)
    with (root / "build" / ".firmware-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield root


def _make(root: Path, target: str) -> Path:
    command = ["make", "-s", "-C", str(root / "arduino"), f"../build/{target}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    # No AssertionError: a control that cannot be built is not one that fails its check.
    if done.returncode:
        raise host_build.BuildFailed(done.stderr)
    return root / "build" / target
