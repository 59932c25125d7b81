"""Independent pieces of work and the crew that does them, with equal results whoever it is."""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from rigctl.errors import WorkersLost

Job = TypeVar("Job")
Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many pieces are finished, and how many there are."""


class Executor(Protocol):
    """Who does pieces of work. Linear algebra keeps to one thread each, so no bit depends on it."""

    @property
    def shares_disk(self) -> bool:
        """Whether everybody in it runs on this machine, and so may write into one mapped file."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences for the report on what this crew may change."""

    def must_see(self, folders: Sequence[Path]) -> None:
        """Raises WrongUse where somebody in it does not see one of the folders."""

    def map(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Results in the order of the jobs. ``work`` must be a module's function (it is pickled).

        Whoever stops asking for results should close the iterator: what is left is not done then.
        """

    def map_unlocked(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """The same for work that spends its time without the interpreter's lock, in any thread."""


class _OnThisMachine:
    shares_disk = True
    remarks: tuple[str, ...] = ()

    def must_see(self, folders: Sequence[Path]) -> None:
        """Everybody here does."""


class ThreadExecutor(_OnThisMachine):
    """This process, one job after another."""

    def map(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Each result is worked out when it is asked for."""
        for job in jobs:
            with one_blas_thread():
                result = work(job)
            yield result

    def map_unlocked(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Each result is worked out when it is asked for."""
        yield from map(work, jobs)


HERE: Final[Executor] = ThreadExecutor()


class ProcessExecutor(_OnThisMachine):
    """Processes on this machine, started when first needed and kept; see :func:`processes`."""

    def __init__(self, pool: ProcessPoolExecutor, n: int) -> None:
        self._pool = pool
        self._n = n

    def map(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Raises CrewLost where a process died."""
        waiting: deque[Future[Result]] = deque()
        try:
            waiting.extend(self._pool.submit(work, job) for job in jobs)
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            raise WorkersLost(
                "a process of the analysis died, perhaps for want of memory: "
                "free some, or use fewer --workers"
            ) from error
        finally:
            for future in waiting:
                future.cancel()

    def map_unlocked(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """In threads of this process: they start at once, and nothing is pickled."""
        if len(jobs) < 2:
            yield from map(work, jobs)
            return
        pool = ThreadPoolExecutor(min(self._n, len(jobs)))
        try:
            yield from pool.map(work, jobs)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def processes(n: int) -> Iterator[Executor]:
    """A crew of ``n`` processes, or this one alone for ``n`` = 1; gone at the end."""
    if n == 1:
        yield HERE
        return
    # Forked processes would inherit threads and open files; fresh ones start clean everywhere.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(n, context, initializer=_one_thread)
    try:
        yield ProcessExecutor(pool, n)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def work_through(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    crew: Executor = HERE,
    stage: str = "",
    progress: Progress = lambda stage, done, all_: None,
) -> Iterator[Result]:
    """What :meth:`Executor.map` gives, telling how far it is."""
    progress(stage, 0, len(jobs))
    for number, result in enumerate(crew.map(work, jobs), start=1):
        progress(stage, number, len(jobs))
        yield result


def one_blas_thread() -> threadpool_limits:
    """Have linear algebra keep to one thread in this process, for good or in a ``with``."""
    # Only libraries that are loaded can be limited, and SciPy brings one of its own.
    import scipy.linalg  # noqa: F401

    return threadpool_limits(1, "blas")


def _one_thread() -> None:
    # Ctrl-C reaches every process of a terminal; the first one alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    one_blas_thread()
