"""Where running engines are: a folder of the user's own, and in it a small file for each engine.

The folder is private (0700) and checked before anything is in it. The file of an engine says how to
connect to it: its socket or its port, the token that a client must show, its process id and the
path of its live data. The engine removes it when it ends; a reader removes the files of a killed
engine. What an engine leaves has its name and one of a few endings, so that a file with another
name is never touched.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import socket
import stat
import sys
import tempfile
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import platformdirs
from msgspec import Meta

from rigctl import __version__
from rigctl.config.text_file import is_plain_file
from rigctl.errors import WrongUse
from rigctl.experiments import DRUM_EXPERIMENT

LOOPBACK = "127.0.0.1"

_PROBE_TIMEOUT_S = 0.5
_Text = Annotated[str, Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]


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


def place_machine_code() -> None:
    """Let numba keep its machine code beside the engines where it has no place, else it fails.

    Call it before numba is loaded. It has no place where neither the installation nor the home
    takes files. What lies there is executed, so the folder is the user's alone. Raises WrongUse as
    :func:`runtime_folder` does.
    """
    home = Path(platformdirs.user_cache_dir("numba", appauthor=False))
    if not any(map(_takes_files, (Path(__file__).with_name("__pycache__"), home))):
        os.environ.setdefault("NUMBA_CACHE_DIR", str(runtime_folder() / "numba"))


def _takes_files(folder: Path) -> bool:
    """Return whether files can be made in a folder, or the folder itself."""
    while not folder.exists():
        folder = folder.parent
    return folder.is_dir() and os.access(folder, os.W_OK)


def refuse_folder(folder: Path, error: OSError) -> WrongUse:
    """Return the error for a folder for running engines that takes no files."""
    return WrongUse(
        f"the folder for running engines {folder} takes no files ({error.strerror}): make room "
        f"there, or set {FOLDER_VARIABLE} to another folder of your own"
    )


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


def is_crash_report(log: Path) -> bool:
    """Return whether an engine's log has an unexpected error, of Python or of native code."""
    try:
        text = log.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return "Traceback (most recent call last)" in text or "Fatal Python error" in text


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


@dataclass(frozen=True, slots=True)
class EngineFile:
    """Connection data of one engine. ``socket``: path of its socket, empty where it has a port."""

    name: Annotated[str, Meta(pattern=rf"\A{ENGINE_NAME}\Z")]
    pid: Annotated[int, Meta(ge=1, lt=1 << 31)]
    port: Annotated[int, Meta(ge=0, lt=1 << 16)]
    token: Annotated[str, Meta(max_length=128)]
    rig: _Text
    live: _Text
    experiment: Annotated[str, Meta(max_length=64)] = DRUM_EXPERIMENT
    socket: _Text = ""
    version: _Text = __version__
    """Of rigctl; clients of another version may stop the engine, and no more."""
    world: _Text = ""
    """Path of the world file of a simulated rig."""


def rig_name(rig: str) -> str:
    """Return a rig as engine files name it: a file by its whole path, so that one bench has one."""
    path = Path(rig)
    return str(path.resolve()) if path.suffix == ".toml" else rig


def engine_file_path(folder: Path, name: str) -> Path:
    """Return the path of the engine's file."""
    return folder / (name + ENGINE_FILE)


def write_engine_file(folder: Path, engine: EngineFile) -> Path:
    """Write the file in one step, so that a reader sees all of it or nothing; return its path.

    Removes what engines that were killed long ago have left. Raises WrongUse where the folder takes
    no files.
    """
    path, draft = engine_file_path(folder, engine.name), folder / (engine.name + DRAFT)
    try:
        draft.unlink(missing_ok=True)
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump(asdict(engine), file)
        written_s = draft.lstat().st_mtime
        draft.replace(path)
    except OSError as error:
        raise refuse_folder(folder, error) from error
    running = {other.name for other in running_engines(folder)}
    remove_abandoned(folder, running | {engine.name}, written_s)
    return path


def read_engine_file(path: Path) -> EngineFile | None:
    """Return the contents of the file, None where it is absent or not what an engine writes."""
    if not is_plain_file(path):
        return None
    try:
        return msgspec.json.decode(path.read_bytes(), type=EngineFile)
    except (OSError, ValueError, RecursionError):
        return None


def running_engines(folder: Path) -> list[EngineFile]:
    """Return the running engines, newest first; remove the files of dead ones."""
    running: list[EngineFile] = []
    for path in sorted(folder.glob("*" + ENGINE_FILE), key=_modified_s, reverse=True):
        engine = read_engine_file(path)
        if engine is not None and is_running(engine):
            running.append(engine)
        elif engine is not None:
            remove_files(folder, engine.name)
    return running


def is_running(engine: EngineFile) -> bool:
    """Return whether the engine's process is there and something answers where it listens.

    The process id alone says nothing: after the engine's end the system gives it to others.
    """
    if not _has_process(engine.pid):
        return False
    with connecting_socket(engine) as probe:
        probe.settimeout(_PROBE_TIMEOUT_S)
        try:
            probe.connect(socket_address(engine))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
        except OSError:
            return True  # it is too busy to answer
    return True


def connecting_socket(engine: EngineFile) -> socket.socket:
    """Return a new socket of the family that the engine listens on."""
    return socket.socket(socket.AF_UNIX if engine.socket else socket.AF_INET, socket.SOCK_STREAM)


def socket_address(engine: EngineFile) -> str | tuple[str, int]:
    """Return the address that the engine listens at."""
    return engine.socket or (LOOPBACK, engine.port)


def _modified_s(path: Path) -> float:
    """Return when the file was written, 0 where it has just been removed."""
    try:
        return path.lstat().st_mtime
    except FileNotFoundError:
        return 0.0


def _has_process(pid: int) -> bool:
    if sys.platform == "win32":  # signal 0 would end the process there
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
