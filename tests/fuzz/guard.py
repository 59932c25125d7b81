"""What a reading may do: no other error than rigctl's own, a second, its memory, its own folder."""

from __future__ import annotations

import asyncio
import ctypes
import gc
import os
import resource
import signal
import struct
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import h5py

from rigctl.errors import RigctlError
from tests.fuzz.kind import Content, Door, Kind
from tests.fuzz.mutations.hdf5 import SENTINEL

HANG_S = 1.0
"""Processor time of a reading above that of a whole file."""
WATCH_S, IDLE_S = 20.0, 0.02
"""A reading that uses no more processor time than this in ``WATCH_S`` waits, such as for a pipe."""
MEMORY_BYTES = 256 << 20
SENTENCE_LETTERS = 1500
CHECKOUT = Path(__file__).resolve().parents[2]
_IN_ACCESS, _IN_MODIFY, _IN_ATTRIB, _IN_OPEN, _IN_DELETE = 1, 2, 4, 0x20, 0x200
_IN_ISDIR = 0x40000000
"""Somebody lists the folder, such as a search of the whole computer."""


_FOLDERS_AT: dict[str, tuple[int | None, ...]] = {
    **dict.fromkeys(("os.remove", "os.rmdir"), (1,)),
    "os.mkdir": (2,),
    "os.rename": (2, 3),
    "os.link": (2, 3),
    "os.symlink": (None, 2),
}
"""Where the arguments of an event say which open folder each of its paths is relative to."""
WRITES = frozenset(("os.remove", "os.rename", "os.rmdir", "os.mkdir", "os.link", "os.symlink"))
_EVENTS = WRITES | {"open", "os.truncate", "os.chmod", "os.utime", "os.listdir"}


class TooLong(BaseException):
    """A reading takes too long; no ``except Exception`` of the program stops it."""


class WritesOutside(BaseException):
    """A reading was about to change something outside its folder; it is stopped before that."""


@dataclass(frozen=True)
class Finding:
    """What a reading did wrong: the kind of failure, where (for counting), and the details."""

    failure: str
    where: str
    details: str


class Guard:
    """Runs doors on cases under limits. One for each process: it hooks signals and auditing."""

    def __init__(self, workplace: Path) -> None:
        self._workplace = workplace.resolve()
        self._readable = tuple(
            {str(CHECKOUT), sys.prefix, sys.base_prefix, *filter(None, sys.path)}
        )
        self._case: Path | None = None
        self._outside: list[str] = []
        self._sentinel = _Sentinel(self._workplace / SENTINEL)
        self.baseline_s: dict[str, float] = {}
        self._unraisable: list[BaseException] = []
        self._left_open = 0
        sys.addaudithook(self._audit)
        sys.unraisablehook = self._keep_unraisable
        signal.signal(signal.SIGPROF, raise_too_long)
        signal.signal(signal.SIGALRM, self._end_wait)

    def limit_memory(self, largest_bytes: int) -> None:
        """Allow twice the largest file or 256 MiB beyond what the process has now."""
        now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        room = max(2 * largest_bytes, MEMORY_BYTES)
        resource.setrlimit(resource.RLIMIT_AS, (now + room, resource.RLIM_INFINITY))

    def measure(self, kind: Kind, folder: Path) -> None:
        """Read a whole case twice, so that everything is loaded, and keep the time it takes."""
        for door in kind.doors:
            for _ in range(2):
                began_s = time.process_time()
                with self._watching(folder, 60.0):
                    door(folder)
                self.baseline_s[_name(door)] = time.process_time() - began_s
        if self._outside or self._sentinel.touched():
            raise AssertionError(f"a whole {kind.name} reads outside: {self._outside}")

    def judge(
        self, kind: Kind, folder: Path, pristine: object, doors: Sequence[Door]
    ) -> list[Finding]:
        """Read a damaged case through these doors; return what went wrong."""
        self._sentinel.touched()  # by the mutation, such as of a data set that lies there
        found: list[Finding] = []
        first: object = None
        for door in doors:
            found += self._judge_door(door, folder)
            first = self._returned if door is doors[0] else first
        if kind.content is not None and not found and first is not None:
            content = self._content(kind.content, folder, first)
            if content is not None and content != pristine:
                found.append(Finding("false accept", kind.name, _differences(pristine, content)))
        return found

    def _judge_door(self, door: Door, folder: Path) -> Iterator[Finding]:
        name = _name(door)
        limit_s = HANG_S + self.baseline_s.get(name, 0.5)
        self._returned: object = None
        with Attempt() as attempt, self._watching(folder, limit_s):
            self._returned = door(folder)
        if isinstance(attempt.error, TooLong):
            took = f"{name} took more than {limit_s:.1f} s of processor, or waited"
            yield Finding("hang", _where(attempt.error), took + _trace(attempt.error))
        elif attempt.error is not None:
            yield from self._judge_error(name, attempt.error)
        printed, self._unraisable = self._unraisable, []
        for error in printed:
            where = f"{type(error).__name__} while an object was released"
            yield Finding("traceback", where, f"{name} prints {_trace(error)}")
        outside, self._outside = self._outside, []
        if outside:
            yield Finding("outside", f"{name} {outside[0].split(' ')[0]}", "\n".join(outside))
        if self._sentinel.touched():
            yield Finding("outside", f"{name} in the library", f"{name} opened {SENTINEL}")
        yield from self._judge_handles(name)

    def _judge_handles(self, name: str) -> Iterator[Finding]:
        """Yield whether files were left open. Not closed here: HDF5 may die of what it holds."""
        if _open_files() > self._left_open:
            gc.collect()
        left, self._left_open = _open_files() - self._left_open, _open_files()
        if left > 0:
            yield Finding("left open", name, f"{name} left {left} HDF5 files open")

    def _judge_error(self, name: str, error: BaseException) -> Iterator[Finding]:
        if isinstance(error, RigctlError):
            yield from _judge_sentence(name, error)
        elif isinstance(error, MemoryError):
            yield Finding("memory", _where(error), f"{name}: {_trace(error)}")
        elif isinstance(error, WritesOutside):
            self._outside.append(f"stopped in {_where(error)}")
        else:
            where = f"{type(error).__name__} {_where(error)}"
            yield Finding("traceback", where, f"{name}: {_trace(error)}")

    def _content(self, content: Content, folder: Path, first: object) -> object:
        """Return what an accepted case says; None where its content is not to be judged."""
        found: object = None
        with Attempt(), self._watching(folder, 60.0):
            found = content(folder, first)
        self._outside.clear()
        self._sentinel.touched()
        return found

    @contextmanager
    def _watching(self, folder: Path, limit_s: float) -> Iterator[None]:
        self._case = folder.resolve()
        signal.setitimer(signal.ITIMER_PROF, limit_s)
        self._used_s = time.process_time()
        signal.setitimer(signal.ITIMER_REAL, WATCH_S, WATCH_S)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            self._case = None

    def _keep_unraisable(self, unraisable: sys.UnraisableHookArgs) -> None:
        if unraisable.exc_value is not None:
            self._unraisable.append(unraisable.exc_value)

    def _end_wait(self, number: int, frame: FrameType | None) -> None:
        before_s, self._used_s = self._used_s, time.process_time()
        if self._used_s - before_s < IDLE_S:
            raise TooLong("it waits")

    def _audit(self, event: str, args: tuple[Any, ...]) -> None:
        if self._case is None or event not in _EVENTS:
            return
        case, self._case = self._case, None
        try:
            for path in _paths(event, args):
                if not self._may_touch(event, path, args, case):
                    self._outside.append(f"{event} {path} {_here()}")
                    if event in WRITES or (event == "open" and not _only_reads(args)):
                        raise WritesOutside(f"{event} {path}")
        finally:
            self._case = case

    def _may_touch(self, event: str, path: str, args: tuple[Any, ...], case: Path) -> bool:
        follows = event != "open" or not isinstance(args[2], int) or not args[2] & os.O_NOFOLLOW
        folder, name = Path(path).parent, Path(path).name
        resolved = os.path.realpath(path if follows else folder)
        resolved = resolved if follows else f"{resolved}/{name}"
        if resolved == str(case) or resolved.startswith(f"{case}/"):
            return True
        reads = event == "os.listdir" or (event == "open" and _only_reads(args))
        own = (*self._readable, "/proc/", "/usr/", "/sys/", "/etc/local")
        if reads and resolved.startswith(own) and not resolved.startswith(str(self._workplace)):
            return True
        return resolved in ("/dev/null", "/dev/urandom") or "__pycache__" in resolved


class Attempt:
    """Something that may fail in any way: keeps the error, which ends at the end of the block."""

    error: BaseException | None = None

    def __enter__(self) -> Attempt:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: object
    ) -> bool:
        self.error = error
        return not isinstance(error, KeyboardInterrupt | asyncio.CancelledError)


class _Sentinel:
    """A file that nobody may open, also not a library that Python's auditing does not see."""

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"secret" * 1000)
        libc = ctypes.CDLL(None, use_errno=True)
        self._descriptor = libc.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        watched = _IN_ACCESS | _IN_MODIFY | _IN_ATTRIB | _IN_OPEN | _IN_DELETE
        if libc.inotify_add_watch(self._descriptor, str(path.parent).encode(), watched) < 0:
            raise OSError(ctypes.get_errno(), "inotify_add_watch")

    def touched(self) -> bool:
        """Return whether it was opened since the last call."""
        try:
            data = os.read(self._descriptor, 65536)
        except BlockingIOError:
            return False
        at, found = 0, False
        while at < len(data):
            _, mask, _, length = struct.unpack_from("<iIII", data, at)
            found |= not mask & _IN_ISDIR
            at += 16 + length
        return found


def raise_too_long(number: int, frame: FrameType | None) -> None:
    """End what runs, as the handler of a signal."""
    raise TooLong(f"signal {number}")


def _judge_sentence(name: str, error: RigctlError) -> Iterator[Finding]:
    """Yield what is wrong with a refusal: several lines, a page of letters, or nothing at all.

    What acts on a terminal is escaped where it is printed.
    """
    text = str(error)
    if not text.strip() or "\n" in text or len(text) > SENTENCE_LETTERS:
        what = "lines" if "\n" in text else "length"
        details = f"{name}: {len(text)} letters: {text[:2000]!r}"
        yield Finding("sentence", f"{what} {_where(error)}", details)


def _name(door: Door) -> str:
    return getattr(door, "__name__", repr(door))


def _open_files() -> int:
    return int(h5py.h5f.get_obj_count(h5py.h5f.OBJ_ALL, h5py.h5f.OBJ_FILE))


def _where(error: BaseException) -> str:
    """Return the innermost place in the program where an error came from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"{CHECKOUT}/rigctl" in frame.filename] or list(frames)
    if not own:
        return "nowhere"
    path = Path(own[-1].filename)
    shown = path.relative_to(CHECKOUT) if path.is_relative_to(CHECKOUT) else path
    return f"{shown}:{own[-1].name}"


def _trace(error: BaseException) -> str:
    lines = traceback.format_exception(error)
    text = "".join(lines)
    return "\n" + (text if len(text) < 8000 else text[:2000] + "\n…\n" + text[-6000:])


def _here() -> str:
    frames = [f for f in traceback.extract_stack() if f"{CHECKOUT}/rigctl" in f.filename]
    return f"({Path(frames[-1].filename).name}:{frames[-1].name})" if frames else ""


def _paths(event: str, args: tuple[Any, ...]) -> Iterator[str]:
    """Yield the paths of an event; one relative to an open folder with that folder."""
    places = _FOLDERS_AT.get(event, (None,))
    for arg, at in zip(args, places, strict=False):
        if isinstance(arg, str | bytes | os.PathLike):
            folder = args[at] if at is not None else -1
            within = Path(f"/proc/self/fd/{folder}").readlink() if folder not in (-1, None) else ""
            yield os.fsdecode(Path(within) / os.fsdecode(arg))


def _only_reads(args: tuple[Any, ...]) -> bool:
    mode, flags = args[1], args[2]
    if isinstance(mode, str):
        return not set(mode) & set("wax+")
    return isinstance(flags, int) and not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)


def _differences(pristine: object, content: object) -> str:
    if isinstance(pristine, dict) and isinstance(content, dict):
        keys = pristine.keys() | content.keys()
        changed = sorted(str(k) for k in keys if pristine.get(k) != content.get(k))
        return f"accepted, although these changed: {', '.join(changed[:20])}"
    return f"accepted as {content!r:.500}, is {pristine!r:.500}"
