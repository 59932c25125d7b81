"""Build the images that the tests run, safely from several test processes."""

from __future__ import annotations

import fcntl
import hashlib
import subprocess
import sys
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
    if name not in BROKEN.get(board, {}):
        with build_lock() as root:
            return _make(root, target)
    with _edited(board, name) as arduino:
        return _make(arduino.parent, f"firmware/{board}.elf")


def all_built() -> Path:
    """Build what ``make firmware`` builds, where it is out of date; return the images' folder."""
    with build_lock() as root:
        _run_make(root)
        return root / "build" / "firmware"


def host_library(board: str, name: str, output: Path) -> Path:
    """Compile a board that is named in BROKEN for this computer; return the path ``output``.

    Sources that read the same are compiled once for all names.
    """
    with _edited(board, name) as arduino:
        sources = host_build.sources(board, arduino)
        headers = b"".join(path.read_bytes() for path in sources if path.suffix == ".h")
        objects = [
            _object(board, path, headers, arduino) for path in sources if path.suffix == ".cpp"
        ]
        return host_build.compiled(board, objects, output, ["-shared"], arduino)


def _object(board: str, source: Path, headers: bytes, arduino: Path) -> Path:
    shipped = f"{host_build.digest(board)} {source.name}".encode()
    content = hashlib.sha256(shipped + headers + source.read_bytes()).hexdigest()
    target = arduino.parents[1] / "objects" / f"{content}.o"
    if not target.is_file():
        host_build.compiled(board, [source], target, ["-c"], arduino)
    return target


@contextmanager
def build_lock(part: str = "firmware") -> Iterator[Path]:
    """Yield the checkout while no other test process builds that part in it."""
    root = checkout()
    assert root is not None
    (root / "build").mkdir(exist_ok=True)
    with (root / "build" / f".{part}-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield root


@contextmanager
def _edited(board: str, name: str) -> Iterator[Path]:
    """Yield the edited copy of ``arduino/`` while no other process builds in it.

    Each has a lock of its own: nobody waits for an image that he does not run.
    """
    with build_lock(f"{board}-{name}") as root:
        folder = root / "build" / "broken" / f"{board}-{name}"
        yield edited_copy(root / "arduino", board, name, folder)


def _make(root: Path, target: str) -> Path:
    _run_make(root, f"../build/{target}")
    return root / "build" / target


def _run_make(root: Path, *targets: str) -> None:
    # The Python that runs the tests, whatever another test has made of PATH.
    command = ["make", "-s", "-C", str(root / "arduino"), f"PYTHON={sys.executable}", *targets]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    # No AssertionError: a control that cannot be built is not one that fails its check.
    if done.returncode:
        raise host_build.BuildFailed(done.stderr)
