"""A cache of computed arrays in files, and the resources of an analysis.

The key of an entry is a digest of everything that determines its content, so no entry is ever out
of date. Entries are written whole and renamed; a damaged one is computed again and replaced.
Reading an entry marks it as recently used; the least recently used entries go first when the folder
has grown too large.
"""

from __future__ import annotations

import hashlib
import io
import lzma
import os
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tokenize import TokenError
from typing import Any, Final

import numpy as np
import platformdirs
from numpy.typing import NDArray

import rigctl.encoder
from rigctl.analysis.executors import SERIAL, Executor, Progress, R, T
from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse

Arrays = dict[str, NDArray[Any]]
MAX_BYTES = 4 * 2**30
RACY_NS = 2 * 10**9
"""A file that was modified so recently may change again with the same modification time."""
NUMPY_ERRORS = (
    *(AttributeError, ValueError, EOFError, RuntimeError, MemoryError, SyntaxError, KeyError),
    *(TokenError, zipfile.BadZipFile, zlib.error, lzma.LZMAError, TypeError),
)
"""What NumPy and zipfile raise for damaged files."""
NAMES = "names"
"""Array of an entry with the names of the others: zipfile overlooks a member that damage hides."""


def cache_folder() -> Path:
    """Return the default folder of entries: in $XDG_CACHE_HOME or ~/.cache on Linux."""
    return Path(platformdirs.user_cache_dir("rigctl", appauthor=False))


class Cache:
    """Entries in a folder; a cache without a ``folder`` stores nothing.

    ``hits`` and ``misses`` count the requests. A full disk must not end an analysis: the first
    entry that cannot be written ends the writing, and :attr:`remarks` says so.
    """

    hits = misses = 0
    remarks: tuple[str, ...] = ()
    """A sentence where an entry could not be written."""

    def __init__(self, folder: Path | None = None, max_bytes: int = MAX_BYTES) -> None:
        self._folder = folder
        self._max_bytes = max_bytes

    def __contains__(self, key: str) -> bool:
        """Return whether there is a file for the key, even a damaged one."""
        return self._folder is not None and self._path(key).is_file()

    def get(self, key: str) -> Arrays | None:
        """Return the entry of the key, None where there is no whole one."""
        if self._folder is None:
            return None
        path = self._path(key)
        try:
            entry = _read(path)
        except (OSError, WrongUse, *NUMPY_ERRORS):
            return None
        names = entry.pop(NAMES, None)
        if names is None or names.tolist() != sorted(entry):
            return None
        with suppress(OSError):  # another process removed it, or the folder is read-only
            os.utime(path)
        return entry

    def put(self, key: str, arrays: Arrays) -> None:
        """Write an entry."""
        if self._folder is None or self.remarks:
            return
        path = self._path(key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, arrays)
        except OSError as error:
            self.remarks = (f"the cache {self._folder} cannot be written ({error}): see --cache",)

    def trim(self) -> None:
        """Remove the least recently used entries until the others are small enough."""
        if self._folder is None:
            return
        found = []
        for path in self._folder.glob("??/*"):  # also what a killed process left behind
            with suppress(FileNotFoundError):
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        total = 0
        for _, size, path in sorted(found, reverse=True):
            total += size
            if total > self._max_bytes:
                path.unlink(missing_ok=True)

    def trusts_mtime(self, modified_ns: int) -> bool:
        """Return whether a file modified then can no longer change within the clock's steps."""
        if self._folder is None:
            return False
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self._folder) as now:
                return modified_ns < os.fstat(now.fileno()).st_mtime_ns - RACY_NS
        except OSError:
            return False

    def _path(self, key: str) -> Path:
        return (self._folder or Path()) / key[:2] / f"{key}.npz"


@dataclass(frozen=True, slots=True)
class Resources:
    """Resources of an analysis: an executor, a cache and a progress callback."""

    executor: Executor = SERIAL
    cache: Cache = field(default_factory=Cache)
    progress: Progress = lambda stage, done, total: None

    def map(self, function: Callable[[T], R], tasks: Sequence[T], stage: str) -> Iterator[R]:
        """Yield the results in task order and report progress."""
        self.progress(stage, 0, len(tasks))
        for done, result in enumerate(self.executor.map(function, tasks), start=1):
            self.progress(stage, done, len(tasks))
            yield result

    def map_cached(
        self, function: Callable[[T], Arrays], tasks: Sequence[T], keys: Sequence[str], stage: str
    ) -> Iterator[Arrays]:
        """Yield the results in task order, from the cache where it has them.

        ``function`` releases the interpreter's lock. A result with an empty key is not cached.
        """
        self.progress(stage, 0, len(tasks))
        cached = [bool(key) and key in self.cache for key in keys]
        missing = [task for task, found in zip(tasks, cached, strict=True) if not found]
        computed = self.executor.map_nogil(function, missing)
        for done, (task, key, found) in enumerate(zip(tasks, keys, cached, strict=True), start=1):
            result = self.cache.get(key) if found else None
            if result is None:
                self.cache.misses += 1
                result = function(task) if found else next(computed)
                if key:
                    self.cache.put(key, result)
            else:
                self.cache.hits += 1
            self.progress(stage, done, len(tasks))
            yield result


SERIAL_RESOURCES: Final = Resources()
"""This process alone, without a cache."""


def cache_key(*parts: Any) -> str:
    """Return a digest of plain values, byte strings and arrays, and of the encoder's source."""
    digest = hashlib.sha256(code_digest())
    for part in parts:
        if isinstance(part, np.ndarray):
            data = np.ascontiguousarray(part)
            encoded = f"{data.dtype.str}{data.shape}".encode() + data.tobytes()
        else:
            encoded = part if isinstance(part, bytes) else repr(part).encode()
        digest.update(len(encoded).to_bytes(8, "little") + encoded)
    return digest.hexdigest()


@cache
def code_digest() -> bytes:
    """Return the SHA-256 of the source that encodes and counts, as entries of other code differ."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    sources = sorted(Path(rigctl.encoder.__path__[0]).rglob("*.py"))
    for path in (*sources, here / "spike_counts.py"):
        digest.update(path.read_bytes())
    return digest.digest()


def _read(path: Path) -> Arrays:
    """Return the arrays of an entry. Raises WrongUse for what is no plain file."""
    with open_file(path) as file, zipfile.ZipFile(file) as archive:
        # Reading a member to its end compares its checksum, which numpy.load does not.
        contents = {name: io.BytesIO(archive.read(name)) for name in archive.namelist()}
    return {
        name.removesuffix(".npy"): np.load(content, allow_pickle=False)
        for name, content in contents.items()
    }


def _write(path: Path, arrays: Arrays) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, suffix=".new")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays, **{NAMES: np.array(sorted(arrays))})
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
