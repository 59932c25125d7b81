"""Executors that run independent tasks; the results do not depend on which one runs them."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from threadpoolctl import threadpool_limits

from rigctl.errors import WorkersLost

T = TypeVar("T")
R = TypeVar("R")
Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished tasks and the number of tasks."""


class Executor:
    """This process, which runs each task when its result is requested; base of other executors.

    Each worker computes with one BLAS thread, so that no bit depends on the number of workers.
    ``is_local``: whether all workers run on this machine and so may write into one mapped file.
    """

    is_local = True

    def check_visible(self, folders: Sequence[Path]) -> None:
        """Raise WrongUse where a worker does not see one of the folders."""

    def map(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """Yield the results in task order. ``function`` must be a module's (it is pickled).

        A caller that stops early closes the iterator, which cancels the remaining tasks. Raises
        WorkersLost where workers are gone for good.
        """
        for task in tasks:
            with limit_blas_threads():
                result = function(task)
            yield result

    def map_nogil(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """Do the same, in any thread, for a function that releases the interpreter's lock."""
        yield from map(function, tasks)


SERIAL: Final = Executor()


class ProcessExecutor(Executor):
    """Processes on this machine that start at the first task; see :func:`local_executor`."""

    def __init__(self, pool: ProcessPoolExecutor, n_workers: int) -> None:
        self._pool = pool
        self._n_workers = n_workers

    def map(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """Yield the results in task order. Raises WorkersLost where a process died."""
        try:
            yield from self._pool.map(function, tasks)
        except BrokenProcessPool as error:
            raise WorkersLost(
                "a process of the analysis died, possibly for lack of memory: "
                "free some, or use fewer --workers"
            ) from error

    def map_nogil(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """Yield the results from threads of this process, which need no start and no pickling."""
        pool = ThreadPoolExecutor(min(self._n_workers, max(1, len(tasks))))
        try:
            yield from pool.map(function, tasks)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def local_executor(n_workers: int) -> Iterator[Executor]:
    """Yield an executor of ``n_workers`` processes, or this process alone for 1."""
    if n_workers == 1:
        yield SERIAL
        return
    # Forked processes would inherit threads and open files; fresh ones start clean everywhere.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(n_workers, context, initializer=_initialize_worker)
    try:
        yield ProcessExecutor(pool, n_workers)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def limit_blas_threads() -> threadpool_limits:
    """Limit BLAS to one thread in this process, permanently or within a ``with``."""
    # Only libraries that are loaded can be limited, and SciPy brings one of its own.
    import scipy.linalg  # noqa: F401

    return threadpool_limits(1, "blas")


def _initialize_worker() -> None:
    # Ctrl-C reaches every process of a terminal; the first one alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_blas_threads()
