"""Read one file after another in a process that may die of each: a program without threads.

It reads one JSON object per line and answers each with one letter. A fork of it does the reading,
so that no file finds what another has left behind. It knows nothing of rigctl and loads no more
than h5py needs: a fork of so small a process is quick, and sound on every system that has one.
"""

from __future__ import annotations

import ctypes
import faulthandler
import gc
import json
import mmap
import os
import select
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
from h5py import h5a, h5d, h5g, h5l, h5o

LONGEST_S = 60.0
MOST_OBJECTS = 10_000
SURVIVED, DIED, USELESS = b".", b"x", b"?"
"""Answers; the last one: even a sound file cannot be read here, so that nothing can be told."""
_ERRORS = (
    *(OSError, RuntimeError, KeyError, ValueError, TypeError, IndexError, OverflowError),
    MemoryError,
)
"""What h5py raises for damage: a refusal in order, which the program meets itself."""
_CONTROL_S = 5.0
_EXIT = ctypes.CDLL(None).exit


def serve() -> None:
    """Answer requests until the program that sent them closes its end."""
    import resource  # Windows has none

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # the deaths of forks leave no files
    gc.freeze()  # each fork looks for garbage among its own objects only
    os.write(sys.stdout.fileno(), SURVIVED)
    for line in sys.stdin:
        os.write(sys.stdout.fileno(), _judge(json.loads(line)))


def _judge(request: dict[str, Any]) -> bytes:
    """Return the answer for one file."""
    if request["kind"] == "mat5":
        import_module("scipy.io.matlab")  # here once, not in each fork
    read = READERS[request["kind"]]
    if survives(partial(read, request), request["processor_s"]):
        return SURVIVED
    return DIED if survives(_read_control, _CONTROL_S) else USELESS


def survives(work: Callable[[], object], processor_s: float) -> bool:
    """Return whether a fork comes to the end of ``work``, in order or with an error of Python's."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        _work_and_exit(work, processor_s)
    os.close(writer)
    has_ended, _, _ = select.select([reader], [], [], LONGEST_S)  # which closes its end
    os.close(reader)
    if not has_ended:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return status == 0


def _work_and_exit(work: Callable[[], object], processor_s: float) -> None:
    """Work as the fork and exit as a program in C does, which lets HDF5 free its memory.

    What a file has damaged in it is noticed then at the latest.
    """
    try:
        faulthandler.disable()  # what the fork dies of is told in a sentence
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, processor_s)
        work()
    finally:
        _EXIT(0)


def _read_control() -> None:
    """Read a sound file, which lies in memory."""
    with h5py.File("control", "w", driver="core", backing_store=False) as file:
        file["group/rows"] = [1, 2]
        _walk(h5g.open(file.id, b"/"))


def _read_mat5(request: dict[str, Any]) -> None:
    from scipy.io import loadmat

    loadmat(request["path"], simplify_cells=True)


def _read_hdf5(request: dict[str, Any]) -> None:
    """Walk through a file's structure; what is refused in order is refused by the program, too."""
    options = request["options"]
    if "libver" in options:
        options["libver"] = tuple(options["libver"])
    try:
        file = h5py.File(_source(request), "r", **options)
    except _ERRORS:
        return
    try:
        root = h5g.open(file.id, b"/")
    except _ERRORS:
        return
    try:
        _walk(root)
        gc.collect()
        file.close()
    except _ERRORS:
        # As one that died: HDF5 dies of names looked up in a group or of attributes that it cannot
        # list, and what it cannot close stays open for ever.
        os._exit(1)


def _source(request: dict[str, Any]) -> str | mmap.mmap:
    """Return the file, or its bytes with another head."""
    path, head = Path(request["path"]), bytes.fromhex(request["head"])
    if not head:
        return str(path)
    with path.open("rb") as file:
        image = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    image[: len(head)] = head
    return image


def _walk(root: Any) -> None:
    """Open every object once, its attributes and its index of chunks.

    What is wrong with one object, the program meets itself. Raises where a group or the attributes
    of an object cannot be listed.
    """
    places, seen = [root], set[int]()
    while places and len(seen) < MOST_OBJECTS:
        node = places.pop()
        with suppress(*_ERRORS):
            address = h5o.get_info(node).addr
            if address in seen:
                continue
            seen.add(address)
        names: list[bytes] = []
        h5a.iterate(node, names.append)
        if len(names) != h5a.get_num_attrs(node):
            raise OSError("the index of the attributes does not agree with their number")
        with suppress(*_ERRORS):
            _read_object(node, names)
        if isinstance(node, h5g.GroupID):
            places += _open_links(node, list(node))


def _read_object(node: Any, names: Sequence[bytes]) -> None:
    for name in names:
        h5a.open(node, name).get_type()
    if isinstance(node, h5d.DatasetID):
        _walk_chunks(node)


def _open_links(group: Any, names: Sequence[bytes]) -> list[Any]:
    """Return what hard links lead to, without those that HDF5 refuses to open."""
    found = []
    for name in names:
        with suppress(*_ERRORS):
            if group.links.get_info(name).type == h5l.TYPE_HARD:
                found.append(h5o.open(group, name))
    return found


def _walk_chunks(node: Any) -> None:
    node.get_type()
    plist = node.get_create_plist()
    if plist.get_layout() == h5d.CHUNKED:
        node.chunk_iter(lambda chunk: None)


READERS: dict[str, Callable[[dict[str, Any]], None]] = {"hdf5": _read_hdf5, "mat5": _read_mat5}

if __name__ == "__main__":
    serve()
