"""Files from anywhere, read up to a declared size: no pipe, device or folder, nothing endless."""

from __future__ import annotations

import os
import stat
from io import BufferedReader
from pathlib import Path

from rigctl.errors import WrongUse

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
_WITHOUT_WAITING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def kind_of(path: Path) -> str:
    """Return what is at ``path`` if it is no plain file, such as ``a pipe``; else an empty text.

    A path without anything, or one that the system refuses, has no kind.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # ValueError: a zero byte in the path
        return ""
    return _KINDS.get(stat.S_IFMT(mode), "")


def is_plain_file(path: Path) -> bool:
    """Return whether there is a file that can be read to its end; never raises."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def refuse_link_outside(path: Path, error: type[WrongUse] = WrongUse) -> None:
    """Raise ``error`` for a link that leads out of its own folder; the folder may be a link."""
    try:
        is_link = path.is_symlink()
    except OSError:  # such as a name that is too long: opening it says so
        return
    if not is_link:
        return
    folder, target = os.path.realpath(path.parent), Path(os.path.realpath(path))
    if not target.is_relative_to(folder):
        raise error(
            f"{path} is a link to a file outside its folder, which may not be followed: put the "
            "file itself there"
        )


def open_file(path: Path, error: type[WrongUse] = WrongUse) -> BufferedReader:
    """Open a plain file for reading. Raises ``error`` for anything else; never waits."""
    if kind := kind_of(path):
        raise error(f"cannot read {path}: it is {kind}, not a file")
    try:
        return os.fdopen(os.open(path, os.O_RDONLY | _WITHOUT_WAITING), "rb")
    except ValueError as problem:
        raise error(f"cannot read {str(path)!r}: a path has no zero byte") from problem
    except OSError as problem:
        raise error(f"cannot read {path}: {problem.strerror}") from problem


def read_bytes(path: Path, limit: int, error: type[WrongUse] = WrongUse) -> bytes:
    """Return the content of a plain file of up to ``limit`` bytes, which bounds the memory too.

    Raises ``error`` for a larger file, and for whatever is no plain file.
    """
    with open_file(path, error) as file:
        try:
            content = file.read(limit + 1)
        except OSError as problem:
            raise error(f"cannot read {path}: {problem.strerror}") from problem
    if len(content) > limit:
        raise error(f"{path} is larger than {limit:,} bytes: it cannot be what it should be")
    return content


def read_text(path: Path, limit: int, error: type[WrongUse] = WrongUse) -> str:
    """Return the text of a UTF-8 file of up to ``limit`` bytes, with line ends as ``\\n``.

    Raises ``error`` as :func:`read_bytes`, and for bytes that are not UTF-8.
    """
    try:
        text = read_bytes(path, limit, error).decode("utf-8")
    except UnicodeDecodeError as problem:
        raise error(f"{path} is not UTF-8 text") from problem
    return text.replace("\r\n", "\n").replace("\r", "\n")
