"""Start an engine as a process of its own, and wait until it can be connected to."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from rigctl.acquisition.rpc.engine_files import EngineFile, engine_file_path, read_engine_file
from rigctl.acquisition.rpc.runtime_folder import LOG
from rigctl.errors import RigctlError, RigFault

COMPILE_TIMEOUT_S = 600.0
"""An engine's first start after an update compiles, on a busy machine for minutes; an engine that
ends instead is noticed immediately."""
_POLL_S = 0.02


class EngineRefusal(RigctlError):
    """The engine's refusal, with the exit code for a program that ends because of it."""

    def __init__(self, sentence: str, exit_code: int) -> None:
        super().__init__(sentence)
        self.exit_code = exit_code


def spawn_engine(
    folder: Path, name: str, rig: str, paced: bool, seed: int, run: Sequence[str], command: str
) -> tuple[subprocess.Popen[bytes], IO[bytes]]:
    """Start an engine in its own process group, so that our Ctrl-C does not reach it."""
    words = [sys.executable, "-m", "rigctl", command, "--rig", rig, "--name", name]
    words += ["--seed", str(seed), *(["--paced"] if paced else []), *run]
    log = (folder / (name + LOG)).open("w+b")
    process = subprocess.Popen(
        words,
        stdin=subprocess.DEVNULL,
        stdout=log,
        stderr=log,
        start_new_session=sys.platform != "win32",
        creationflags=0x200 if sys.platform == "win32" else 0,  # CREATE_NEW_PROCESS_GROUP
    )
    return process, log


def wait_for_engine_file(
    folder: Path, name: str, process: subprocess.Popen[bytes], log: IO[bytes]
) -> EngineFile:
    """Wait for the engine's file. Raises EngineRefusal with its last line where it ends instead."""
    path = engine_file_path(folder, name)
    for _ in range(round(COMPILE_TIMEOUT_S / _POLL_S)):
        found = read_engine_file(path)
        if found is not None:
            return found
        try:
            code = process.wait(_POLL_S)
        except subprocess.TimeoutExpired:
            continue
        raise EngineRefusal(_last_line(log), code if code > 0 else 3)
    process.terminate()
    process.wait()
    raise RigFault(f"the engine did not start within {COMPILE_TIMEOUT_S:.0f} s: see {log.name}")


def _last_line(log: IO[bytes]) -> str:
    log.seek(0)
    lines = log.read().decode(errors="replace").strip().splitlines()
    last = lines[-1] if lines else "the engine ended without a message: start it again"
    return last.removeprefix("rigctl: ")
