"""The file of a running engine that says how to connect to it: one small private file per engine.

The file is in a folder of the user's own (:mod:`rigctl.acquisition.rpc.runtime_folder`), is
readable by the user alone (0600), and holds the socket or the port, the token that a client must
show, the engine's process id and the path of its live data. The engine removes it when it ends;
a reader removes the files of a killed engine.
"""

from __future__ import annotations

import json
import os
import socket
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from rigctl.acquisition.rpc.runtime_folder import (
    DRAFT,
    ENGINE_FILE,
    ENGINE_NAME,
    LIVE,
    SOCKET,
    remove_abandoned,
    remove_files,
)

DRUM_EXPERIMENT, FINGER_EXPERIMENT = "drum", "finger"
"""What an engine runs: clients of one experiment do not join the other's engine."""
LOOPBACK = "127.0.0.1"

_SIZE_LIMIT_BYTES = 1 << 16
_PROBE_TIMEOUT_S = 0.5
_READ: int = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)
_Text = Annotated[str, Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]


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


def rig_name(rig: str) -> str:
    """Return a rig as engine files name it: a file by its whole path, so that one bench has one."""
    path = Path(rig)
    return str(path.resolve()) if path.suffix == ".toml" else rig


def engine_file_path(folder: Path, name: str) -> Path:
    """Return the path of the engine's file."""
    return folder / (name + ENGINE_FILE)


def write_engine_file(folder: Path, engine: EngineFile) -> Path:
    """Write the file in one step, so that a reader sees all of it or nothing; return its path.

    Removes what engines that were killed long ago have left.
    """
    path, draft = engine_file_path(folder, engine.name), folder / (engine.name + DRAFT)
    draft.unlink(missing_ok=True)
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        json.dump(asdict(engine), file)
    written_s = draft.lstat().st_mtime
    draft.replace(path)
    running = {other.name for other in running_engines(folder)}
    remove_abandoned(folder, running | {engine.name}, written_s)
    return path


def read_engine_file(path: Path) -> EngineFile | None:
    """Return the contents of the file, None where it is absent or not what an engine writes."""
    try:
        engine = msgspec.json.decode(_read(path), type=EngineFile)
    except (OSError, ValueError, RecursionError):
        return None
    return engine if _has_own_paths(engine, path) else None


def _read(path: Path) -> bytes:
    """Return the file's bytes; a link is not followed, and a pipe holds nobody."""
    descriptor = os.open(path, _READ)
    try:
        return os.read(descriptor, _SIZE_LIMIT_BYTES)
    finally:
        os.close(descriptor)


def _has_own_paths(engine: EngineFile, path: Path) -> bool:
    """Return whether the file names itself and only files beside it."""
    beside = path.parent / engine.name
    return (
        path.name == engine.name + ENGINE_FILE
        and engine.live in ("", f"{beside}{LIVE}")
        and engine.socket in ("", f"{beside}{SOCKET}")
    )


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
