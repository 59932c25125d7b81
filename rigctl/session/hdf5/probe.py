"""Let another process read an HDF5 file's structure first, because HDF5 may die of it.

Metadata that is wrong but has right checksums can end a process inside HDF5 2.0 by a signal, or
damage its memory: about one of 150 such changes did. So a fork of a helper opens the file and walks
through all that describes its data, and this process opens the file only if the fork came through.
Not on Windows, which has no ``fork``, and not for a file that a living writer appends to.

The helper is a program of its own (:mod:`rigctl.session.hdf5.probe_child`), because a fork of this
process beside its threads may hang, and on macOS die, of what its libraries hold.
"""

from __future__ import annotations

import atexit
import json
import os
import select
import subprocess
import sys
import threading
from contextlib import suppress
from functools import cache
from mmap import mmap
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.hdf5 import probe_child
from rigctl.session.hdf5.probe_child import DIED, LONGEST_S, SURVIVED, USELESS

PROCESSOR_S = 0.5
"""Of the fork, in which HDF5 may also never come to an end; a sound part takes 10 ms."""
START_S = 60.0
END_S = 5.0
_HEAD_BYTES = 64
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Of the helper: a process that forks has no threads."""


def check_survivable(path: Path, image: mmap | None, options: dict[str, Any]) -> None:
    """Raise SessionError where a process that reads the structure of the file would die of it.

    ``image``: the file's bytes with another head. A file is not tried again until it changes.
    """
    status = path.stat()
    known = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, image is None)
    judged = _judged()
    if known not in judged:
        head = bytes(image[:_HEAD_BYTES]).hex() if image is not None else ""
        judged[known] = survives("hdf5", path, PROCESSOR_S, head=head, options=options)
    if not judged[known]:
        raise SessionError(
            f"{path} is damaged: a process that reads its structure dies of it, or never ends"
        )


@cache
def _judged() -> dict[tuple[int, ...], bool]:
    """Return whether each file that this process tried came through.

    A file is known by its device, number, size, time, and whether it has another head.
    """
    return {}


def survives(kind: str, path: Path, processor_s: float, **request: Any) -> bool:
    """Return whether a process comes to the end of reading a file, or to an error of Python's.

    ``kind``: one of the helper's readers, for which ``request`` is. ``processor_s``: what the
    process may take of a processor. True on Windows, and where no process can read a sound file.
    """
    if sys.platform == "win32":
        return True
    absolute = str(path.absolute())
    return _helper().survives(
        {"kind": kind, "path": absolute, "processor_s": processor_s, **request}
    )


def start_helper() -> None:
    """Start this process's helper before the first file needs it; nothing happens on Windows."""
    if sys.platform != "win32":
        _helper().start()


@cache
def _helper() -> ProbeHelper:
    """Return this process's helper."""
    helper = ProbeHelper()
    atexit.register(helper.close)
    os.register_at_fork(after_in_child=helper.forget)
    return helper


class ProbeHelper:
    """A process that reads files for this one, one after another; safe to use in threads.

    It is started by the first file and after its own death, and ends with this process, however
    that ends, because it reads a pipe that only this process holds open.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_ready = False

    def survives(self, request: dict[str, Any]) -> bool:
        """Return whether a fork of the helper comes through a file.

        True where the helper cannot tell: it must never refuse what is sound.
        """
        line = json.dumps(request).encode() + b"\n"
        with self._lock:
            answer = self._ask(line) or self._ask(line)
        return answer != DIED

    def start(self) -> None:
        """Start the process without a file; the first file waits until it is ready."""
        with self._lock:
            if self._process is None:
                with suppress(OSError):  # the first file tries again
                    self._process, self._is_ready = _start(), False

    def close(self) -> None:
        """End the helper."""
        process, self._process = self._process, None
        if process is None:
            return
        _close_pipes(process)
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def forget(self) -> None:
        """Leave the helper to the process that this one is a fork of."""
        process, self._process = self._process, None
        self._lock = threading.Lock()
        if process is not None:
            _close_pipes(process)
            process.returncode = 0  # it is no child of this process, which need not wait for it

    def _ask(self, line: bytes) -> bytes:
        """Return the helper's answer, empty where it died or could not be started."""
        try:
            if self._process is None:
                self._process, self._is_ready = _start(), False
            if not self._is_ready and _read_answer(self._process, START_S) != SURVIVED:
                raise BrokenPipeError
            self._is_ready = True
            _write(self._process, line)
            answer = _read_answer(self._process, 2 * LONGEST_S + END_S)
        except OSError:
            answer = b""
        if answer not in (SURVIVED, DIED, USELESS):
            self._kill()
            return b""
        return answer

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
        self.close()


def _start() -> subprocess.Popen[bytes]:
    """Start the helper where it finds the same libraries as this process."""
    folders = [str(Path(folder).absolute()) for folder in sys.path if folder]
    return subprocess.Popen(
        [sys.executable, "-P", "-W", "ignore", probe_child.__file__],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        cwd=os.sep,
        env={
            **os.environ,
            **dict.fromkeys(_ONE_THREAD, "1"),
            "PYTHONPATH": os.pathsep.join(folders),
        },
        process_group=0,  # Ctrl-C is for this process
    )


def _write(process: subprocess.Popen[bytes], line: bytes) -> None:
    assert process.stdin is not None
    view = memoryview(line)
    while view:
        view = view[os.write(process.stdin.fileno(), view) :]


def _read_answer(process: subprocess.Popen[bytes], timeout_s: float) -> bytes:
    """Return one letter, empty where none comes."""
    assert process.stdout is not None
    waiting = select.poll()
    waiting.register(process.stdout.fileno(), select.POLLIN)
    return os.read(process.stdout.fileno(), 1) if waiting.poll(timeout_s * 1000) else b""


def _close_pipes(process: subprocess.Popen[bytes]) -> None:
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
