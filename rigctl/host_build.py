"""Compile the boards' firmware for this computer: the libraries of the virtual boards.

``python -m rigctl.host_build`` compiles what is stale; so do ``make firmware`` and
``pip install``. This module imports nothing of rigctl, because the build hook of the
installation loads it by its path.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ARDUINO = ROOT / "arduino"
BOARDS = ("drum", "taxels", "finger")
# The finger board frames its bytes as the taxel board does.
_SHARED = {"finger": ("taxels/cobs.cpp", "taxels/cobs.h", "taxels/crc32.cpp", "taxels/crc32.h")}
CURE = "install a C++ compiler (g++ or clang++) or `pip install ziglang`, then run "
COMMAND = "python -m rigctl.host_build"
_SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
_WARNINGS = ("-Wall", "-Wextra", "-Werror")
# Fused multiply-add rounds once and would give other numbers than other compilers.
_FLAGS = ("-std=gnu++17", "-O2", "-ffp-contract=off", "-fvisibility=hidden")


class BuildFailed(Exception):
    """There is no compiler, or it refused the sources; the message says what to do."""


def dynamic_library_name(board: str) -> str:
    """Return the file name of a board's library on this system."""
    return f"virtual-{board}{_SUFFIX}"


def dynamic_library_path(board: str) -> Path:
    """Return the path of a board's library in a checkout."""
    return ROOT / "build" / "host" / dynamic_library_name(board)


def sources(board: str, arduino: Path = ARDUINO) -> list[Path]:
    """Return the sources of a board's library: its portable core and its host body."""
    core, body = arduino / board, arduino / "host"
    files = [*core.glob("*.cpp"), *core.glob("*.h"), *body.glob("*.h"), *(body / board).iterdir()]
    shared = [arduino / name for name in _SHARED.get(board, ())]
    return sorted(path for path in files + shared if not path.name.startswith("chip"))


def digest(board: str) -> str:
    """Return the SHA-256 of a board's sources with their names, hexadecimal.

    It covers the image's sources too, because the library reports the image's build hash.
    """
    sha256 = hashlib.sha256(image_hash(board).encode())
    for path in sources(board):
        sha256.update(path.name.encode() + b"\0" + path.read_bytes().replace(b"\r\n", b"\n"))
    return sha256.hexdigest()


def image_hash(board: str) -> str:
    """Return the build hash of the chip's image of the same sources, as its Makefile does."""
    folder = ARDUINO / board
    files = [*folder.glob("*.cpp"), *folder.glob("*.h"), *folder.glob("*.ino")]
    content = b"".join(path.read_bytes() for path in sorted(files, key=lambda path: path.name))
    return hashlib.sha256(content).hexdigest()[:8]


def compiler() -> list[str]:
    """Return the command of a C++ compiler: CXX, the system's, or Zig's from PyPI.

    Raises BuildFailed where there is none.
    """
    if command := os.environ.get("CXX", "").split():
        return command
    for path in map(shutil.which, ("c++", "g++", "clang++")):
        if path:
            return [path]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "c++"]
    raise BuildFailed(f"no C++ compiler for the virtual boards: {CURE}{COMMAND}")


def build(
    board: str,
    output: Path | None = None,
    defines: Sequence[str] = (),
    arduino: Path = ARDUINO,
) -> Path:
    """Compile a board's library with ``-D`` options and return its path. Raises BuildFailed.

    From another copy of ``arduino/`` it still names the sources of this one, which it varies.
    """
    files = [path for path in sources(board, arduino) if path.suffix == ".cpp"]
    options = ["-shared", *(f"-D{define}" for define in defines)]
    return compiled(board, files, output or dynamic_library_path(board), options, arduino)


def compiled(
    board: str, files: Sequence[Path], target: Path, options: Sequence[str], arduino: Path
) -> Path:
    """Compile sources and objects of a board to a file and return its path. Raises BuildFailed."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        # A library of macOS keeps the name that it was made with.
        partial = Path(folder) / target.name
        _compile(board, files, partial, options, arduino)
        # A running process may have the old library loaded.
        partial.replace(target)
    return target


def _compile(
    board: str, files: Sequence[Path], output: Path, options: Sequence[str], arduino: Path
) -> None:
    folders = {board, f"host/{board}", *(name.split("/")[0] for name in _SHARED.get(board, ()))}
    command = [
        *compiler(),
        *options,
        *_FLAGS,
        *_WARNINGS,
        *([] if sys.platform == "win32" else ["-fPIC"]),
        f"-DBUILD_HASH=0x{image_hash(board)}UL",
        f'-DSOURCES="{digest(board)}"',
        *(f"-I{arduino / folder}" for folder in sorted(folders)),
        *map(str, files),
        *("-o", str(output)),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildFailed(f"{command[0]} could not compile the {board} board:\n{done.stderr}")


def build_stale() -> list[Path]:
    """Compile missing and stale libraries and return their paths. Raises BuildFailed."""
    return [build(board) for board in BOARDS if not _is_fresh(board)]


def _is_fresh(board: str) -> bool:
    path = dynamic_library_path(board)
    return path.is_file() and digest(board).encode() in path.read_bytes()


def main() -> int:
    """Compile what is stale and return an exit code."""
    try:
        for path in build_stale():
            print(path)
    except BuildFailed as failed:
        print(failed, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
