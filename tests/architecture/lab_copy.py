"""A copy of the program in which a lab has edited some files, and programs that run in it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from tests.architecture.imports import CHECKOUT

FOLDERS = ("arduino", "build/host", "docs", "gui", "protocols", "rigctl")
Edits = Mapping[str, Mapping[str, str]]
"""By file: what stands there once, and what it becomes. A new file has the key "" alone."""


def copy_program(folder: Path, edits: Edits) -> Path:
    """Return a copy of the program with these edits; it keeps compiled kernels and boards."""
    copy = folder / "program"
    for name in FOLDERS:
        shutil.copytree(CHECKOUT / name, copy / name)
    shutil.copy(CHECKOUT / "pyproject.toml", copy)
    for name, changes in edits.items():
        text = "" if "" in changes else (copy / name).read_text(encoding="utf-8")
        for before, after in changes.items():
            assert text.count(before) == 1, f"{name}: {before}"
            text = text.replace(before, after)
        (copy / name).write_text(text, encoding="utf-8")
    return copy


def run_in(copy: Path, *arguments: str) -> str:
    """Run Python with the copy's modules before the checkout's; return its output."""
    path = os.pathsep.join(map(str, (copy, CHECKOUT)))
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=copy,
        env={**os.environ, "PYTHONPATH": path, "QT_QPA_PLATFORM": "offscreen"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def changed_files(copy: Path) -> set[str]:
    """Return the files of the copy that differ from the checkout's."""
    files = (path for name in FOLDERS for path in (copy / name).rglob("*") if path.is_file())
    names = {path.relative_to(copy).as_posix() for path in files}
    names = {name for name in names if "__pycache__" not in name and not name.startswith("build")}
    return {name for name in names if _bytes(copy / name) != _bytes(CHECKOUT / name)}


def _bytes(path: Path) -> bytes | None:
    return path.read_bytes() if path.is_file() else None
