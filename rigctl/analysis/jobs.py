"""Independent pieces of work, one after another or in several processes, with equal results."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")
Result = TypeVar("Result")
Progress = Callable[[str, int, int], None]
"""Called with what is being done, how many pieces are finished, and how many there are."""


def work_through(
    work: Callable[[Job], Result],
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    stage: str = "",
    progress: Progress = lambda stage, done, all_: None,
) -> Iterator[Result]:
    """Results in the order of the jobs. ``work`` must be a module's function (it is pickled).

    Linear algebra keeps to one thread a process, so that results do not depend on ``workers``.
    """
    progress(stage, 0, len(jobs))
    done = _here(work, jobs) if workers <= 1 or len(jobs) < 2 else _there(work, jobs, workers)
    for number, result in enumerate(done, start=1):
        progress(stage, number, len(jobs))
        yield result


def _here(work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
    for job in jobs:
        with threadpool_limits(1, "blas"):
            result = work(job)
        yield result


def _there(work: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[Result]:
    # Forked processes would inherit threads and open files; fresh ones start clean everywhere.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(jobs)), context, initializer=_one_thread)
    try:
        yield from pool.map(work, jobs)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _one_thread() -> None:
    # Ctrl-C reaches every process of a terminal; the first one alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(1, "blas")
