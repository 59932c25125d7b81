"""Lock file for the one writer of a session; the operating system releases it if the owner dies."""

from __future__ import annotations

import errno
import os
import socket
import sys
from enum import Enum
from pathlib import Path

from rigctl.config.text_file import kind_of, read_bytes
from rigctl.errors import DiskFault, SessionError

LOCK_FILE = "writer.lock"
LONGEST_TEXT = 320
"""Bytes of a lock file: a process id and a computer's name, in a line each."""
NAMELESS = "localhost"
"""A name that says nothing: many computers have it."""
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""What a file system without locks answers, such as that of many network drives."""

if sys.platform == "win32":
    import msvcrt

    _BYTE_BEHIND_THE_TEXT = 4096

    def try_lock(descriptor: int) -> None:
        """Lock a file. Raises OSError where another process has the lock, or there are none."""
        os.lseek(descriptor, _BYTE_BEHIND_THE_TEXT, os.SEEK_SET)
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        os.lseek(descriptor, 0, os.SEEK_SET)
else:
    import fcntl

    def try_lock(descriptor: int) -> None:
        """Lock a file. Raises OSError where another process has the lock, or there are none."""
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class WriterLock:
    """Lock on ``writer.lock`` in a session's folder from construction to :meth:`release`.

    The file contains the owner's process id and its computer's name, also after the owner died
    without releasing it.
    Raises SessionError while another writer lives and where the file system has no locks, and
    DiskFault if the folder is not writable.
    """

    def __init__(self, folder: Path) -> None:
        self._path = _lock_path(folder)
        self._descriptor = self._acquire()
        os.ftruncate(self._descriptor, 0)
        os.lseek(self._descriptor, 0, os.SEEK_SET)
        os.write(self._descriptor, f"{os.getpid()}\n{socket.gethostname()}\n".encode())

    def release(self) -> None:
        """Remove the lock file and release the lock."""
        if self._descriptor < 0:
            return
        if sys.platform != "win32":  # unlink while locked, or two writers could hold it
            self._path.unlink(missing_ok=True)
        os.close(self._descriptor)
        self._descriptor = -1
        if sys.platform == "win32":
            self._path.unlink(missing_ok=True)

    def _acquire(self) -> int:
        while True:
            descriptor = self._open()
            try:
                try_lock(descriptor)
            except OSError as error:
                os.close(descriptor)
                raise SessionError(_refusal(self._path.parent, error)) from error
            if self._is_current(descriptor):
                return descriptor
            os.close(descriptor)

    def _open(self) -> int:
        try:
            return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise DiskFault(
                f"cannot write into {self._path.parent}: {error.strerror}; "
                "choose a folder that you may write to"
            ) from error

    def _is_current(self, descriptor: int) -> bool:
        """Return False if the owner released, and so removed, the file between open and lock."""
        try:
            return os.path.samestat(os.fstat(descriptor), self._path.stat())
        except FileNotFoundError:
            return False


def _lock_path(folder: Path) -> Path:
    """Return the path of the lock file, which may be missing.

    Raises SessionError for a pipe, which would be waited for, and for a link, as the file that it
    leads to would be emptied: a session comes from anywhere.
    """
    path = folder / LOCK_FILE
    if kind := "a link" if path.is_symlink() else kind_of(path):
        raise SessionError(f"{path} is {kind}, not a file: move it elsewhere")
    return path


def lock_owner_pid(folder: Path) -> int | None:
    """Return the process id in the lock file; None without a lock file."""
    pid = _lines(folder)[0]
    return int(pid) if pid.isdigit() else None


class Writer(Enum):
    """What a session's lock says of its writer; without a lock, or from elsewhere, it is unknown.

    A network may not carry the locks of the operating system, so only the writer's own computer
    says that it is gone.
    """

    LIVES = "lives"
    GONE = "gone"
    UNKNOWN = "unknown"


def writer_of(folder: Path) -> Writer:
    """Return what has become of a session's writer.

    Takes the lock for an instant only where the writer's process id is in use, so that it hardly
    ever keeps a new writer out.
    """
    pid = lock_owner_pid(folder)
    if pid is None:
        return Writer.UNKNOWN
    is_here = lock_owner_computer(folder) == socket.gethostname()
    if is_here and not _has_process(pid):
        return Writer.GONE
    try:
        if _is_locked(folder):
            return Writer.LIVES
    except OSError:
        return Writer.UNKNOWN
    return Writer.GONE if is_here else Writer.UNKNOWN


def lock_owner_computer(folder: Path) -> str:
    """Return the computer's name in the lock file; empty without one that says which it is."""
    name = _lines(folder)[1]
    return "" if name.partition(".")[0] == NAMELESS or not name.isprintable() else name


def _lines(folder: Path) -> tuple[str, str]:
    """Return the lines of the lock file, empty where they are missing."""
    try:
        text = read_bytes(_lock_path(folder), LONGEST_TEXT, SessionError)
    except SessionError:
        return "", ""
    pid, _, name = text.decode(errors="replace").strip().partition("\n")
    return pid.strip(), name.strip()


def _has_process(pid: int) -> bool:
    """Return whether a process has this id; where that cannot be asked, that one has."""
    if sys.platform == "win32":  # signal 0 would end it there
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def is_being_written(folder: Path) -> bool:
    """Return whether a living process writes the session; no one does where there are no locks."""
    try:
        return _is_locked(folder)
    except OSError:
        return False


def _is_locked(folder: Path) -> bool:
    """Return whether a process has the lock. Raises OSError on a file system without locks."""
    try:
        path = _lock_path(folder)
        writable = os.O_RDWR if sys.platform == "win32" else os.O_RDONLY
        descriptor = os.open(path, writable)
    except (OSError, SessionError):
        return False
    try:
        try_lock(descriptor)
    except OSError as error:
        if error.errno in NO_LOCKS:
            raise
        return True
    finally:
        os.close(descriptor)
    return False


def _refusal(folder: Path, error: OSError) -> str:
    if error.errno in NO_LOCKS:
        return (
            f"{folder} is on a file system without locks ({error.strerror}), where two processes "
            "could write one session: write on a local disk, and copy the session afterwards"
        )
    pid = lock_owner_pid(folder)
    writer = f"process {pid}" if pid is not None else "another process"
    return f"{folder} is being written by {writer}: stop that run first, or choose another folder"


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to the medium; Windows has no such call and needs none."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
