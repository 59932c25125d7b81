"""Let a child process read an HDF5 file's structure first, because HDF5 may die of it.

Metadata that is wrong but has right checksums can end a process inside HDF5 2.0 by a signal, or
damage its memory: about one of 150 such changes did. So a forked child opens the file and walks
through all that describes its data, and this process opens the file only if the child came through.
Not on systems without ``fork`` (Windows), and not for a file that a living writer appends to.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import select
import signal
import sys
from collections.abc import Callable
from functools import cache, partial
from mmap import mmap
from pathlib import Path
from typing import Any

import h5py
from h5py import h5a, h5d, h5g, h5l, h5o

from rigctl.errors import SessionError
from rigctl.session.hdf5.errors import HDF5_ERRORS

LONGEST_S = 60.0
PROCESSOR_S = 0.5
"""Of the child, in which HDF5 may also never come to an end; a sound part takes 10 ms."""
MOST_OBJECTS = 10_000
_LASTS = b"."


def check_survivable(path: Path, image: mmap | None, options: dict[str, Any]) -> None:
    """Raise SessionError where a process that reads the structure of the file would die of it.

    ``image``: bytes in place of the file's. A file that came through is not tried again until it
    changes.
    """
    status = path.stat()
    known = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, image is None)
    if sys.platform == "win32" or known in _survivors():
        return
    if not survives(partial(_read_structure, image or path, options), PROCESSOR_S):
        raise SessionError(
            f"{path} is damaged: a process that reads its structure dies of it, or never ends"
        )
    _survivors().add(known)


@cache
def _survivors() -> set[tuple[int, ...]]:
    """Return the files of this process that came through: device, number, size, time, image."""
    return set()


def survives(work: Callable[[], object], processor_s: float) -> bool:
    """Return whether a child comes to the end of ``work``, in order or with an error of Python's.

    ``processor_s``: what it may take of a processor. True on systems without ``fork``.
    """
    if sys.platform == "win32":
        return True
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        _work_and_exit(work, processor_s, writer)
    os.close(writer)
    survived = False
    try:
        ready, _, _ = select.select([reader], [], [], LONGEST_S)
        survived = bool(ready) and os.read(reader, 1) == _LASTS
    finally:
        os.close(reader)
        if not survived:
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    return survived


def _work_and_exit(work: Callable[[], object], processor_s: float, writer: int) -> None:
    """Work as the child; answer, and end without any clean-up whatever happened."""
    try:
        faulthandler.disable()  # what the child dies of is told in a sentence
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, processor_s)
        work()
    finally:
        os.write(writer, _LASTS)
        os._exit(0)


def _read_structure(source: Path | mmap, options: dict[str, Any]) -> None:
    """Read as the child; what is refused in order is refused by the parent, too."""
    try:
        file = h5py.File(source, "r", **options)
    except HDF5_ERRORS:
        return
    try:
        _walk(file)
    except HDF5_ERRORS:
        gc.collect()
    try:
        file.close()
    except RuntimeError:
        os._exit(1)  # without an answer: what HDF5 cannot close stays open for ever


def _walk(file: Any) -> None:
    """Open every object once, its attributes and its index of chunks."""
    places, seen = [h5g.open(file.id, b"/")], set[int]()
    while places and len(seen) < MOST_OBJECTS:
        node = places.pop()
        address = h5o.get_info(node).addr
        if address in seen:
            continue
        seen.add(address)
        names: list[bytes] = []
        h5a.iterate(node, names.append)
        for name in names:
            h5a.open(node, name).get_type()
        if isinstance(node, h5g.GroupID):
            places += [h5o.open(node, name) for name in node if _is_hard(node, name)]
        elif isinstance(node, h5d.DatasetID):
            _walk_chunks(node)


def _is_hard(group: Any, name: bytes) -> bool:
    return bool(group.links.get_info(name).type == h5l.TYPE_HARD)


def _walk_chunks(node: Any) -> None:
    node.get_type()
    plist = node.get_create_plist()
    if plist.get_layout() == h5d.CHUNKED:
        node.chunk_iter(lambda chunk: None)
