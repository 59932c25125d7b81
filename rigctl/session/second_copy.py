"""Copy a session to a second disk, also while it grows: ``rigctl copy``.

A file is copied once nothing writes to it any more: a part when the next one has begun or its
writer is gone. It gets its name when the second disk has all of it, read back from there, so that a
file of that name is always whole. What is there already and is not the same stays as it is.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rigctl.errors import DiskFault, SessionError
from rigctl.session.digests import PartDamage, check_digests
from rigctl.session.extra_stream import stream_paths
from rigctl.session.ground_truth import PARTIAL, log_paths
from rigctl.session.layout import PROTOCOL_FILE, RIG_FILE
from rigctl.session.notes import note_paths
from rigctl.session.part import SUPERBLOCK_BYTES, PartReader, existing_parts, no_session
from rigctl.session.writer_lock import Writer, sync_folder, try_lock, writer_of

DRAFTS = ".copying"
"""Folder within the copy, in which a file lies until all of it is there."""
BLOCK_BYTES = 1 << 22
ROOM_BYTES = 1 << 20
"""To leave free beside a file: for the folder that holds it."""


def is_written(folder: Path) -> bool:
    """Return whether a living process writes the session."""
    return writer_of(folder) is Writer.LIVES


def finished_files(folder: Path) -> list[Path]:
    """Return the files of a session that nothing writes to any more, texts and notes first."""
    parts, streams = existing_parts(folder), stream_paths(folder)
    if is_written(folder):
        parts, streams = parts[:-1], []
    texts = [path for name in (PROTOCOL_FILE, RIG_FILE) if (path := folder / name).is_file()]
    logs = [path for path in log_paths(folder) if path.suffix != PARTIAL]
    return [*texts, *note_paths(folder), *parts, *streams, *logs]


class SessionCopy:
    """The copy of a session in a folder of its name below ``to``, which must be there.

    ``copied`` grows by the names of files that are copied, ``damaged`` by those of parts whose rows
    are not those that their digests cover: they are copied as they are. Raises SessionError for a
    folder that is the session's own.
    """

    def __init__(self, session: Path, to: Path) -> None:
        self.copied: list[str] = []
        self.damaged: list[str] = []
        self._session = session.resolve()
        self._to = to
        self.folder = to / self._session.name
        self._done: set[str] = set()
        if self.folder.resolve() == self._session:
            raise SessionError(f"{to} holds the session itself: name a folder of a second disk")

    def update(self) -> None:
        """Copy what is finished and not there yet.

        Raises DiskFault where the second disk is missing, full or refuses, SessionError where the
        copy's folder has a file that differs or the session is gone; what is copied stays.
        """
        if not existing_parts(self._session) and not is_written(self._session):
            raise no_session(self._session)
        new = [path for path in finished_files(self._session) if path.name not in self._done]
        if not new:
            return
        with self._writable() as is_ours:
            if not is_ours:
                return  # another process copies this session
            there = {path.name for path in new if self._is_there(path)}
            self._done |= there
            for path in new:
                if path.name not in there:
                    self._copy(path)
                    self._done.add(path.name)
                    self.copied.append(path.name)

    @contextmanager
    def _writable(self) -> Iterator[bool]:
        """Yield whether this process may write; raise DiskFault for each error of the disk."""
        if not self._to.is_dir():
            raise DiskFault(f"{self._to} is not there: connect the second disk or make the folder")
        drafts = self.folder / DRAFTS
        try:
            self.folder.mkdir(mode=self._session.stat().st_mode & 0o777, exist_ok=True)
            drafts.mkdir(exist_ok=True)
            with _sole(self.folder) as is_ours:
                yield is_ours
                if is_ours:
                    shutil.rmtree(drafts, ignore_errors=True)
        except OSError as error:
            raise DiskFault(
                f"{self.folder} takes no files ({error.strerror or error}): look at the second disk"
            ) from error

    def _is_there(self, path: Path) -> bool:
        """Return whether the copy has this file. Raises SessionError for one that differs.

        A part that ``rigctl recover`` has closed since is copied again: its rows are the same.
        """
        there = self.folder / path.name
        if not there.exists():
            return False
        if _are_same(path, there):
            return True
        if path in existing_parts(self._session) and _are_same(path, there, SUPERBLOCK_BYTES):
            return False
        raise SessionError(
            f"{there} differs from {path} and is left as it is: move it away, or copy to another "
            "folder"
        )

    def _copy(self, path: Path) -> None:
        size, free = path.stat().st_size, shutil.disk_usage(self._to).free
        if free < size + ROOM_BYTES:
            raise DiskFault(
                f"the disk of {self._to} is full: {path.name} needs {size / 1e6:.1f} MB, make room"
            )
        draft = self.folder / DRAFTS / path.name
        digest = _write(path, draft)
        with draft.open("rb") as copy:
            if hashlib.file_digest(copy, "sha256").digest() != digest:
                raise DiskFault(
                    f"{path.name} reads otherwise on the disk of {self._to} than it was written: "
                    "replace that disk"
                )
        if path in existing_parts(self._session) and not _is_as_recorded(draft):
            self.damaged.append(path.name)
        draft.replace(self.folder / path.name)
        sync_folder(self.folder)


def _write(path: Path, draft: Path) -> bytes:
    """Copy a file to the medium; return the SHA-256 of what was read."""
    digest = hashlib.sha256()
    with path.open("rb") as original, draft.open("wb") as copy:
        while block := original.read(BLOCK_BYTES):
            digest.update(block)
            copy.write(block)
        copy.flush()
        os.fsync(copy.fileno())
        if hasattr(os, "posix_fadvise"):  # so that it is read from the disk, not from memory
            os.posix_fadvise(copy.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)
    with suppress(OSError):  # a file system of another kind may have no such modes
        shutil.copymode(path, draft)
    return digest.digest()


def _is_as_recorded(part: Path) -> bool:
    """Return whether the rows of a part are those that its digests cover."""
    try:
        reader = PartReader(part)
    except SessionError:
        return False
    try:
        damage = check_digests(reader)
    except SessionError:
        return False
    finally:
        reader.close()
    # A killed writer's last flush may have no digest yet.
    return damage == PartDamage(uncovered=damage.uncovered)


def _are_same(one: Path, other: Path, start: int = 0) -> bool:
    """Return whether two files have the same bytes from ``start`` on."""
    if one.stat().st_size != other.stat().st_size:
        return False
    with one.open("rb") as left, other.open("rb") as right:
        left.seek(start)
        right.seek(start)
        while block := left.read(BLOCK_BYTES):
            if block != right.read(BLOCK_BYTES):
                return False
    return True


@contextmanager
def _sole(folder: Path) -> Iterator[bool]:
    """Yield whether this process alone copies into a folder, as far as the system can say."""
    if os.name != "posix":
        yield True
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        yield _has_locked(descriptor)
    finally:
        os.close(descriptor)


def _has_locked(descriptor: int) -> bool:
    """Lock an open folder; return False where another process has the lock."""
    try:
        try_lock(descriptor)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True
