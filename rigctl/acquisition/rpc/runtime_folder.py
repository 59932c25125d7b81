"""The folder of running engines: the user's own, private, and checked before anything is in it.

What an engine leaves in it has the engine's name and one of a few endings, so that a file with
another name is never touched.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from rigctl.errors import WrongUse

FOLDER_VARIABLE = "RIGCTL_RUNTIME"
ENGINE_FILE, DRAFT, LIVE, SOCKET, LOG = ".engine.json", ".engine.draft", ".live", ".sock", ".log"
ENDINGS = (ENGINE_FILE, DRAFT, LIVE, SOCKET, LOG)
"""Endings of the files of one engine."""
ENGINE_NAME = r"[A-Za-z0-9_-]{1,64}"
ABANDONED_S = 3600.0
"""Files without a running engine are removed at this age: an engine may compile before it runs."""

_OWN_FILE = re.compile(f"({ENGINE_NAME})({'|'.join(map(re.escape, ENDINGS))})")


def runtime_folder() -> Path:
    """Return the user's own folder for running engines; create it if necessary.

    ``$RIGCTL_RUNTIME`` if set, else a folder below ``$XDG_RUNTIME_DIR`` or the folder for
    temporary files. Raises WrongUse where the folder is not the user's alone.
    """
    chosen = os.environ.get(FOLDER_VARIABLE) or os.environ.get("XDG_RUNTIME_DIR")
    owner = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    folder = Path(chosen or tempfile.gettempdir()) / f"rigctl-{owner}"
    try:
        folder.mkdir(mode=0o700, parents=True)
    except FileExistsError:
        pass  # checked below, whoever made it
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise WrongUse(
            f"the folder for running engines {folder} cannot be created ({reason}): "
            f"set {FOLDER_VARIABLE} to a folder of your own"
        ) from error
    _require_private(folder)
    return folder


def _require_private(folder: Path) -> None:
    """Raise WrongUse unless this is a real folder of this user that nobody else can enter."""
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode):
        raise WrongUse(
            f"{folder} is not a folder but should be that of running engines: remove it, "
            f"or set {FOLDER_VARIABLE} to a folder of your own"
        )
    if not hasattr(os, "getuid"):
        return  # the system keeps a user's folder for temporary files private
    if found.st_uid != os.getuid():
        raise WrongUse(f"{folder} belongs to another user: set {FOLDER_VARIABLE} to your own")
    if found.st_mode & 0o077:
        mode = stat.S_IMODE(found.st_mode)
        raise WrongUse(
            f"{folder} is open to other users (mode {mode:04o}), who could have put files there: "
            f"look into it, then run chmod 700 {folder}"
        )


def new_engine_name() -> str:
    """Return a random engine name."""
    return secrets.token_hex(4)


def validate_engine_name(name: str) -> str:
    """Return the name. Raises WrongUse where it is not made of safe letters."""
    if not re.fullmatch(ENGINE_NAME, name):
        raise WrongUse(
            f"{name!r} cannot be an engine's name: use up to 64 letters, digits, '-' and '_'"
        )
    return name


def remove_files(folder: Path, name: str) -> None:
    """Remove what an engine that ended has left, but its log.

    Its file is the last one: who finds none finds nothing else of the engine.
    """
    for ending in (SOCKET, LIVE, DRAFT, ENGINE_FILE):
        (folder / (name + ending)).unlink(missing_ok=True)


def remove_abandoned(folder: Path, running: set[str], now_s: float) -> None:
    """Remove files of engines that are not ``running`` and have not been written for an hour.

    ``now_s``: the time as files have it, s.
    """
    for path in folder.iterdir():
        own = _OWN_FILE.fullmatch(path.name)
        if own is None or own[1] in running:
            continue
        with suppress(FileNotFoundError):  # its engine has just removed it
            found = path.lstat()
            if not stat.S_ISDIR(found.st_mode) and now_s - found.st_mtime > ABANDONED_S:
                path.unlink()
