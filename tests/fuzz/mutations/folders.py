"""Damage to a folder: files that are missing, exchanged, doubled, links, pipes, other kinds."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from random import Random

from tests.fuzz.kind import Mutation
from tests.fuzz.mutations.hdf5 import SENTINEL


def remove_file(random: Random, folder: Path) -> str:
    """Remove a file."""
    path = _file(random, folder)
    path.unlink()
    return f"{path.name} removed"


def empty_file(random: Random, folder: Path) -> str:
    """Leave nothing of a file but its name."""
    path = _file(random, folder)
    path.write_bytes(b"")
    return f"{path.name} emptied"


def exchange_files(random: Random, folder: Path) -> str:
    """Exchange two files."""
    first, second = _file(random, folder), _file(random, folder)
    if first == second:
        return "nothing"
    kept = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(kept)
    return f"{first.name} and {second.name} exchanged"


def copy_file(random: Random, folder: Path) -> str:
    """Copy a file to another name, as people and file managers do."""
    path = _file(random, folder)
    names = (
        *(f"{path.stem} (copy){path.suffix}", "part-0009.h5", "part-9999.h5", "part-00001.h5"),
        *("part-0002 (copy).h5", "world.h5", "world-0002.h5", "part-\x1b[2J.h5", "PART-0001.H5"),
        "protocol.toml",
    )
    name = random.choice(names)
    if name == path.name or _is_no_file(folder / name):
        return "nothing"
    shutil.copyfile(path, folder / name)
    return f"{path.name} copied to {name!r}"


def rename_file(random: Random, folder: Path) -> str:
    """Rename a file."""
    path = _file(random, folder)
    name = random.choice(("part-0002.h5", "part-0003.h5", "x", "part-.h5", path.name.upper()))
    if _is_no_file(folder / name):
        return "nothing"
    path.rename(folder / name)
    return f"{path.name} renamed to {name}"


def replace_by_folder(random: Random, folder: Path) -> str:
    """Put a folder in the place of a file."""
    path = _file(random, folder)
    path.unlink()
    path.mkdir()
    return f"{path.name} is a folder"


def replace_by_link(random: Random, folder: Path) -> str:
    """Put a symbolic link in the place of a file: to itself, to nowhere, to a file outside."""
    path = _file(random, folder)
    target = random.choice((path, folder / "nowhere", folder.parent / SENTINEL))
    path.unlink()
    path.symlink_to(target)
    return f"{path.name} links to {target.name}"


def replace_by_pipe(random: Random, folder: Path) -> str:
    """Put a pipe in the place of a file: who opens it waits."""
    path = _file(random, folder)
    path.unlink()
    os.mkfifo(path)
    return f"{path.name} is a pipe"


def forbid(random: Random, folder: Path) -> str:
    """Take the right to read a file (the superuser reads it all the same)."""
    path = _file(random, folder)
    path.chmod(0)
    return f"{path.name} may not be read"


def _is_no_file(path: Path) -> bool:
    """Return whether a mutation before has put a folder, a pipe or a link there."""
    return path.is_symlink() or (path.exists() and not path.is_file())


def _file(random: Random, folder: Path) -> Path:
    files = sorted(path for path in folder.iterdir() if path.is_file() and not path.is_symlink())
    if not files:
        (folder / "x").touch()
        return folder / "x"
    return random.choice(files)


FOLDER: tuple[Mutation, ...] = (
    *(remove_file, empty_file, exchange_files, copy_file, rename_file),
    *(replace_by_folder, replace_by_link, replace_by_pipe, forbid),
)
