"""Where a running engine says how to reach it: one small private file an engine.

The file lies in a folder of the user's own (mode 0700), is readable by the user alone (0600),
and holds the port, the token that a client must show, the engine's process id and where its
live data are. The engine removes it when it ends; one left by a killed engine is swept up.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

from rigctl.errors import WrongUse

FOLDER_VARIABLE = "RIGCTL_RUNTIME"
_SUFFIX = ".engine.json"


@dataclass(frozen=True, slots=True)
class EngineFile:
    """How to reach one engine."""

    name: str
    pid: int
    port: int
    token: str
    rig: str
    live: str


def runtime_folder() -> Path:
    """The user's own folder for running engines, made if need be.

    ``$RIGCTL_RUNTIME`` if set, else a folder below ``$XDG_RUNTIME_DIR`` or the folder for
    temporary files. Raises WrongUse where the folder belongs to somebody else.
    """
    chosen = os.environ.get(FOLDER_VARIABLE) or os.environ.get("XDG_RUNTIME_DIR")
    owner = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    folder = Path(chosen or tempfile.gettempdir()) / f"rigctl-{owner}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise WrongUse(
            f"no folder for running engines can be made at {folder} ({error.strerror}): "
            f"set {FOLDER_VARIABLE} to a folder of your own"
        ) from error
    if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
        raise WrongUse(f"{folder} belongs to another user: set {FOLDER_VARIABLE} to your own")
    return folder


def new_name() -> str:
    """A name that no other engine has."""
    return secrets.token_hex(4)


def announcement_path(folder: Path, name: str) -> Path:
    """Where the engine of that name announces itself."""
    return folder / (name + _SUFFIX)


def announce(folder: Path, announcement: EngineFile) -> Path:
    """Write the file in one step, so that a reader sees all of it or nothing."""
    path = announcement_path(folder, announcement.name)
    draft = path.with_suffix(".draft")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(asdict(announcement), file)
    draft.replace(path)
    return path


def read_announcement(path: Path) -> EngineFile | None:
    """The announcement in that file, None where there is none that makes sense."""
    try:
        return EngineFile(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def running_engines(folder: Path) -> list[EngineFile]:
    """Engines that run now, newest first; what dead ones left behind is removed."""
    alive: list[tuple[float, EngineFile]] = []
    for path in folder.glob("*" + _SUFFIX):
        found = read_announcement(path)
        if found is not None and _is_alive(found.pid):
            alive.append((_written_s(path), found))
        else:
            _sweep(path, found)
    return [found for _, found in sorted(alive, key=lambda item: -item[0])]


def _written_s(path: Path) -> float:
    """When the file was written; 0 for one that is gone just now."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _sweep(path: Path, found: EngineFile | None) -> None:
    path.unlink(missing_ok=True)
    if found is not None:
        Path(found.live).unlink(missing_ok=True)


def _is_alive(pid: int) -> bool:
    if sys.platform == "win32":  # signal 0 would end the process there
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
