"""What was worked out before, kept in files that are found again by what they were made from.

An entry's name is a digest of all that decides its content, so nothing in it can be out of date.
Entries appear whole: they are written under another name first. One that cannot be read or does
not match its own hash is removed and worked out again. Use puts an entry last in the queue of
those that go when the folder has grown too large.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

import rigctl.encoding
from rigctl.analysis.data.fingerprint import hash_of
from rigctl.analysis.execution.executor import HERE, Executor, Progress

Arrays = dict[str, NDArray[Any]]
Job = TypeVar("Job")

MAGIC = b"rigctl entry 1\n\0"
HEAD = struct.Struct("<QI")
MOST_BYTES = 4 * 2**30
FRESH_NS = 2 * 10**9
"""A file changed so shortly ago may change again without showing another time."""


def cache_folder() -> Path:
    """Where entries lie unless somebody says otherwise: in $XDG_CACHE_HOME or in ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "rigctl"


class Cache:
    """Entries in a folder, or none at all where ``folder`` is None.

    ``found`` and ``missed`` count what was asked for. What cannot be written is not kept, and
    :attr:`remarks` says so: a full disk must not end an analysis.
    """

    found = missed = 0

    def __init__(self, folder: Path | None = None, most_bytes: int = MOST_BYTES) -> None:
        self._folder = folder
        self._most_bytes = most_bytes
        self._failure = ""

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence where nothing could be kept."""
        return (self._failure,) if self._failure else ()

    def holds(self, key: str) -> bool:
        """Whether there is an entry of that key, whole or not."""
        return self._folder is not None and self._path(key).is_file()

    def get(self, key: str) -> Arrays | None:
        """The entry of that key, None where there is none."""
        if self._folder is None:
            return None
        path = self._path(key)
        try:
            entry = _unpacked(path.read_bytes())
        except OSError:
            return None
        except (ValueError, KeyError, TypeError, struct.error):
            path.unlink(missing_ok=True)
            return None
        with suppress(OSError):  # somebody removed it meanwhile, or we may only read it
            os.utime(path)
        return entry

    def put(self, key: str, arrays: Arrays) -> None:
        """Keep an entry."""
        if self._folder is None or self._failure:
            return
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, arrays)
        except OSError as error:
            self._failure = f"nothing more was kept in {self._folder} ({error}): see --cache"

    def trim(self) -> None:
        """Remove the entries whose last use is longest ago, until the others are small enough."""
        if self._folder is None:
            return
        held = sorted(_sizes(self._folder), reverse=True)
        total = 0
        for _, size, path in held:
            total += size
            if total > self._most_bytes:
                path.unlink(missing_ok=True)

    def is_settled(self, changed_ns: int) -> bool:
        """Whether a file with that time of change is old enough to be known by it."""
        if self._folder is None:
            return False
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self._folder) as now:
                return changed_ns < os.fstat(now.fileno()).st_mtime_ns - FRESH_NS
        except OSError:
            return False

    def _path(self, key: str) -> Path:
        return (self._folder or Path()) / key[:2] / f"{key}.entry"


def key_of(*parts: Any) -> str:
    """A digest of plain values, byte strings and arrays, and of the code that encodes."""
    digest = hashlib.sha256(code_digest())
    for part in parts:
        if isinstance(part, np.ndarray):
            data = np.ascontiguousarray(part)
            told = f"{data.dtype.str}{data.shape}".encode() + data.tobytes()
        else:
            told = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(told).to_bytes(8, "little") + told)
    return digest.hexdigest()


@cache
def code_digest() -> bytes:
    """Of the source of the encoder and of what counts its spikes: other code, other entries."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    sources = sorted(Path(rigctl.encoding.__path__[0]).rglob("*.py"))
    for path in (*sources, here / "condition_tasks.py", here / "fingerprint.py"):
        digest.update(path.read_bytes())
    return digest.digest()


def remembered(
    work: Callable[[Job], Arrays],
    jobs: Sequence[Job],
    keys: Sequence[str],
    *,
    kept: Cache,
    crew: Executor = HERE,
    stage: str = "",
    progress: Progress = lambda stage, done, all_: None,
) -> Iterator[Arrays]:
    """Results in the order of the jobs: those that are kept, and the others worked out and kept.

    ``work`` spends its time without the interpreter's lock. An empty key is never kept.
    """
    progress(stage, 0, len(jobs))
    known = [bool(key) and kept.holds(key) for key in keys]
    missing = [job for job, there in zip(jobs, known, strict=True) if not there]
    found = crew.map_unlocked(work, missing)
    for number, (job, key, there) in enumerate(zip(jobs, keys, known, strict=True), start=1):
        result = kept.get(key) if there else None
        if result is None:
            kept.missed += 1
            result = work(job) if there else next(found)
            if key:
                kept.put(key, result)
        else:
            kept.found += 1
        progress(stage, number, len(jobs))
        yield result


def _write(path: Path, arrays: Arrays) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".new")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_packed(arrays))
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _packed(arrays: Arrays) -> bytes:
    told = [(name, a.dtype.str, a.shape) for name, a in arrays.items()]
    head = json.dumps(told).encode()
    body = head + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays.values())
    return MAGIC + HEAD.pack(hash_of(np.frombuffer(body, np.uint8)), len(head)) + body


def _unpacked(content: bytes) -> Arrays:
    """Raises ValueError and its like for what :func:`_packed` did not make."""
    hashed, length = HEAD.unpack_from(content, len(MAGIC))
    body = np.frombuffer(content, np.uint8)[len(MAGIC) + HEAD.size :]
    if not content.startswith(MAGIC) or hash_of(body) != hashed:
        raise ValueError("not a whole entry")
    at, arrays = length, {}
    for name, kind, shape in json.loads(body[:length].tobytes()):
        dtype = np.dtype(kind)
        size = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        arrays[name] = body[at : at + size].copy().view(dtype).reshape(shape)
        at += size
    return arrays


def _sizes(folder: Path) -> Iterator[tuple[float, int, Path]]:
    """Last use, size and path of each entry, and of what a killed process left half-written."""
    for path in (*folder.glob("??/*.entry"), *folder.glob("??/*.new")):
        try:
            seen = path.stat()
        except FileNotFoundError:
            continue
        yield seen.st_mtime, seen.st_size, path
