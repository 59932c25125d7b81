"""Refuse paths that are no regular files before anything opens them."""

from __future__ import annotations

import stat
from pathlib import Path

from rigctl.errors import SessionError

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
SHOWN_NAME = 80


def check_regular_file(path: Path) -> int:
    """Return the file's size in bytes; links are followed.

    Raises SessionError for a missing file, a pipe, a device, a folder, and a name that no file can
    have. Opening a pipe would wait for its writer.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise SessionError(f"there is no file {path}") from None
    except (OSError, ValueError) as error:  # a name too long, a NUL, a folder without permission
        reason = error.strerror if isinstance(error, OSError) else "it contains a NUL"
        raise SessionError(f"{_shorten(str(path))} is no usable file: {reason}") from error
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        raise SessionError(f"{path} is {_KINDS.get(kind, 'no regular file')}: give a file")
    return status.st_size


def _shorten(name: str) -> str:
    shown = name.replace("\0", "\\0")
    return shown if len(shown) <= SHOWN_NAME else f"{shown[:SHOWN_NAME]}…"
