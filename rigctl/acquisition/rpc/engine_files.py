"""The file of a running engine that says how to connect to it: one small private file per engine.

The file is in a folder of the user's own (mode 0700), is readable by the user alone (0600),
and holds the port, the token that a client must show, the engine's process id and the path of
its live data. The engine removes it when it ends; a reader removes the file of a killed engine.
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
DRUM_EXPERIMENT, FINGER_EXPERIMENT = "drum", "finger"
"""What an engine runs: clients of one experiment do not join the other's engine."""


@dataclass(frozen=True, slots=True)
class EngineFile:
    """Connection data of one engine."""

    name: str
    pid: int
    port: int
    token: str
    rig: str
    live: str
    experiment: str = DRUM_EXPERIMENT


def runtime_folder() -> Path:
    """Return the user's own folder for running engines; create it if necessary.

    ``$RIGCTL_RUNTIME`` if set, else a folder below ``$XDG_RUNTIME_DIR`` or the folder for
    temporary files. Raises WrongUse where the folder belongs to another user.
    """
    chosen = os.environ.get(FOLDER_VARIABLE) or os.environ.get("XDG_RUNTIME_DIR")
    owner = str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    folder = Path(chosen or tempfile.gettempdir()) / f"rigctl-{owner}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise WrongUse(
            f"the folder for running engines {folder} cannot be created ({error.strerror}): "
            f"set {FOLDER_VARIABLE} to a folder of your own"
        ) from error
    if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
        raise WrongUse(f"{folder} belongs to another user: set {FOLDER_VARIABLE} to your own")
    return folder


def new_engine_name() -> str:
    """Return a random engine name."""
    return secrets.token_hex(4)


def engine_file_path(folder: Path, name: str) -> Path:
    """Return the path of the engine's file."""
    return folder / (name + _SUFFIX)


def write_engine_file(folder: Path, engine: EngineFile) -> Path:
    """Write the file in one step, so that a reader sees all of it or nothing; return its path."""
    path = engine_file_path(folder, engine.name)
    draft = path.with_suffix(".draft")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(asdict(engine), file)
    draft.replace(path)
    return path


def read_engine_file(path: Path) -> EngineFile | None:
    """Return the contents of the file, None where it is absent or invalid."""
    try:
        return EngineFile(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def running_engines(folder: Path) -> list[EngineFile]:
    """Return the running engines, newest first; remove the files of dead ones."""
    running: list[EngineFile] = []
    for path in sorted(folder.glob("*" + _SUFFIX), key=_modified_s, reverse=True):
        engine = read_engine_file(path)
        if engine is not None and _is_alive(engine.pid):
            running.append(engine)
        else:
            path.unlink(missing_ok=True)
            if engine is not None:
                Path(engine.live).unlink(missing_ok=True)
    return running


def _modified_s(path: Path) -> float:
    """Return when the file was written, 0 where it has just been removed."""
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


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
