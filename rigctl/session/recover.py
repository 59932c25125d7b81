"""Close the parts of a session whose writer was killed: ``rigctl recover``.

Only the 48 bytes of the superblock change, so rows and digests stay what they are. The closed copy
takes the part's place in one step: a kill or a full disk leaves the part as it was.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import DiskFault, SessionError
from rigctl.session.part import SUPERBLOCK_BYTES, closed_superblock, existing_parts, no_session
from rigctl.session.session import describe_missing
from rigctl.session.session_reader import open_parts
from rigctl.session.writer_lock import WriterLock, is_being_written, lock_owner_pid, sync_folder


@dataclass(frozen=True, slots=True)
class RecoveryResult:
    """What a recovery did, or would do.

    ``closed``: the names of the parts that are closed. ``missing``: a sentence on each part that
    cannot be read or was cut short, which stays as it is, and on trials that are left out.
    """

    closed: tuple[str, ...]
    missing: tuple[str, ...]


def recover(folder: Path, *, dry_run: bool = False) -> RecoveryResult:
    """Close the killed parts of a session, and say what it lacks.

    With ``dry_run``, change nothing. Raises SessionError while a process writes the session and for
    another kind of folder, DiskFault if there is no room or the disk refuses.
    """
    if not existing_parts(folder):
        raise no_session(folder)
    if is_being_written(folder):
        raise SessionError(
            f"{folder} is being written by process {lock_owner_pid(folder)}: stop that run first"
        )
    killed = _killed_parts(folder)
    if not dry_run:
        lock = WriterLock(folder)  # takes over that of a dead process
        try:
            for path in killed:
                _close(path)
        finally:
            lock.release()
    return RecoveryResult(tuple(path.name for path in killed), tuple(describe_missing(folder)))


def _killed_parts(folder: Path) -> list[Path]:
    """Return the parts that were not closed and have all their rows."""
    parts, _ = open_parts(existing_parts(folder))
    for part in parts:
        part.close()
    return [part.path for part in parts if part.is_cut and not part.cut_rows]


def _close(path: Path) -> None:
    """Put a copy with the superblock of a closed file in a part's place."""
    copy = path.with_name(f"{path.name}.closed")
    try:
        with path.open("rb") as original, copy.open("wb") as closed:
            size = os.fstat(original.fileno()).st_size
            closed.write(closed_superblock(original.read(SUPERBLOCK_BYTES), size))
            shutil.copyfileobj(original, closed, 1 << 22)
            closed.flush()
            os.fsync(closed.fileno())
        shutil.copymode(path, copy)
        copy.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        copy.unlink(missing_ok=True)
        raise DiskFault(
            f"{path} cannot be closed: {error.strerror or error}; make room, it is unchanged"
        ) from error
