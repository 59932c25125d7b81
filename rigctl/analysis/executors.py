"""Executors that run independent tasks; the results do not depend on which one runs them.

This process, processes on this machine, or Dask workers on any machines.
"""

from __future__ import annotations

import logging
import multiprocessing
import platform
import signal
import socket
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from functools import cache, partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, Final, TypeVar
from urllib.parse import urlsplit

from threadpoolctl import ThreadpoolController

from rigctl import __version__
from rigctl.config.resources import source_commit
from rigctl.errors import WorkersLost, WrongUse

T = TypeVar("T")
R = TypeVar("R")
Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished tasks and the number of tasks."""
CONNECT_S = 10.0
TASKS_PER_THREAD = 4
"""Tasks submitted ahead for each worker thread, so that none waits for this process."""
POLL_S = 5.0
POLLS_WITHOUT_WORKERS = 12
NUMERICAL_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")
"""Libraries of which another version may give other bits."""
# A draw names every trial of the set, which Dask would take for data sent by mistake.
DASK_CONFIG = {"distributed.admin.large-graph-warning-threshold": "1GB"}
Versions = dict[str, str]


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


def limit_blas_threads() -> AbstractContextManager[object]:
    """Limit BLAS to one thread in this process, permanently or within a ``with``."""
    limited: AbstractContextManager[object] = _blas_libraries().limit(limits=1)
    return limited


@cache
def _blas_libraries() -> ThreadpoolController:
    """Return those of NumPy and SciPy, found once: a search takes as long as a small fit."""
    # Only libraries that are loaded are found, and SciPy brings one of its own.
    import scipy.linalg  # noqa: F401

    return ThreadpoolController().select(user_api="blas")


def _initialize_worker() -> None:
    # Ctrl-C reaches every process of a terminal; the first one alone decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    limit_blas_threads()


class DaskExecutor(Executor):
    """Workers of one scheduler, which may join, die and return; see :func:`dask_executor`."""

    def __init__(self, client: Any, hosts: set[str]) -> None:
        self._client = client
        self._scheduler = str(client.scheduler.address)
        self.is_local = hosts == {socket.gethostname()}

    def check_visible(self, folders: Sequence[Path]) -> None:
        """Raise WrongUse where a worker does not see a folder as this process does."""
        ours = list(map(_list_folder, folders))
        for name, theirs in _run_on_workers(self._client, _list_folders, list(folders)).items():
            for folder, mine, found in zip(folders, ours, theirs, strict=True):
                if found is None or found != mine:
                    raise WrongUse(
                        f"Dask worker {name} does not see {folder} with its files as this machine "
                        "does: keep sessions and report in a shared folder that has the same path "
                        "on every worker, and wait for the end of a session that is being written"
                    )

    def map(self, function: Callable[[T], R], tasks: Sequence[T]) -> Iterator[R]:
        """Yield the results in task order. Raises WorkersLost where scheduler or workers are gone.

        Another worker repeats the task of a worker that dies. Closing the iterator cancels the
        remaining tasks.
        """
        remaining, pending = iter(tasks), deque[Any]()
        # The versions go with each task, as a worker may have joined after the first check.
        submit = partial(self._client.submit, _run_task, function, own_versions())
        try:
            with self._translate_errors():
                ahead = TASKS_PER_THREAD * max(1, sum(self._client.nthreads().values()))
            for _ in tasks:
                with self._translate_errors():
                    for task in islice(remaining, ahead - len(pending)):
                        pending.append(submit(task, pure=False))
                yield self._result(pending[0])
                pending.popleft().release()
        finally:
            if pending and self._client.status == "running":
                self._client.cancel(list(pending), force=True)

    map_nogil = map

    def _result(self, future: Any) -> Any:
        """Return the result of one future; poll the workers while it takes long."""
        polls_without_workers = 0
        while polls_without_workers < POLLS_WITHOUT_WORKERS:
            with self._translate_errors(future):
                try:
                    return future.result(timeout=POLL_S)
                except TimeoutError:
                    if future.status == "error":
                        raise
                polls_without_workers += not self._client.nthreads()
        raise WorkersLost(
            f"the Dask scheduler {self._scheduler} has had no worker for "
            f"{POLL_S * POLLS_WITHOUT_WORKERS:g} s: start some and repeat the analysis"
        )

    @contextmanager
    def _translate_errors(self, future: Any = None) -> Iterator[None]:
        """Raise WorkersLost for Dask's errors about lost machines; a task's own errors pass."""
        from distributed.client import ClosedClientError, FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            yield
        except KilledWorker as error:
            raise WorkersLost(
                f"a task of the analysis killed {error.allowed_failures + 1} Dask workers, "
                "possibly for lack of memory: give each more, or fewer threads"
            ) from error
        except (FutureCancelledError, ClosedClientError, OSError) as error:
            if future is not None and future.status == "error":
                raise
            raise WorkersLost(
                f"the Dask scheduler {self._scheduler} is gone: start it again and repeat the "
                "analysis"
            ) from error


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Yield an executor over the workers of a scheduler, for example at tcp://host:8786.

    Raises WrongUse where Dask is not installed, no scheduler replies, there is no worker, or a
    worker has other versions than this process.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise WrongUse("--dask needs Dask: pip install 'rigctl[dask]'") from None
    _check_connection(address)
    # Dask's own messages would mix with ours and precede the sentence that says the same.
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    with dask.config.set(DASK_CONFIG):
        client = distributed.Client(address, set_as_default=False, timeout=CONNECT_S)
        try:
            yield DaskExecutor(client, _hosts(client, address))
        finally:
            client.close()
            logger.setLevel(level)


def _check_connection(address: str) -> None:
    """Raise WrongUse where no plain connection opens: Dask's failed start leaves a thread."""
    remedy = "name a scheduler, such as --dask tcp://host:8786 (dask scheduler starts one)"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port or parts.scheme not in ("tcp", "tls"):
        raise WrongUse(f"{address!r} is not the address of a Dask scheduler: {remedy}")
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except OSError as error:
        raise WrongUse(f"no scheduler answers at {address} ({error}): {remedy}") from error


def _hosts(client: Any, address: str) -> set[str]:
    """Return the workers' machines. Raises WrongUse for no worker, or one of other versions."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise WrongUse(
            f"the Dask scheduler {address} has no workers: start some (dask worker {address})"
        ) from None
    for name, versions in _run_on_workers(client, own_versions).items():
        _check_versions(versions, own_versions(), name)
    return set(_run_on_workers(client, socket.gethostname).values())


def _run_on_workers(client: Any, function: Callable[..., Any], *args: Any) -> dict[str, Any]:
    """Run a function on every worker and return the results by worker name."""
    results: dict[str, Any] = client.run(function, *args, on_error="return")
    for name, result in results.items():
        if isinstance(result, Exception):
            raise WrongUse(
                f"Dask worker {name} cannot run rigctl ({result}): install rigctl "
                f"{__version__} there"
            ) from result
    return results


def _check_versions(theirs: Versions, ours: Versions, name: str) -> None:
    for what, our in ours.items():
        if theirs[what] != our:
            raise WrongUse(
                f"Dask worker {name} has {what} {theirs[what]}, this machine {our}: results would "
                "differ; install the same version there"
            )


def _run_task(function: Callable[[T], R], versions: Versions, task: T) -> R:
    """Run a task in a worker, with one BLAS thread, if it has the ``versions`` of the client."""
    from distributed import get_worker

    _limit_blas_threads_once()
    _check_versions(own_versions(), versions, get_worker().address)
    return function(task)


@cache
def _limit_blas_threads_once() -> None:
    # Permanently: the limit is that of the process, so tasks in other threads would lose it too.
    limit_blas_threads()


@cache
def own_versions() -> Versions:
    """Return the versions that determine what this process computes."""
    return {
        "rigctl": f"{__version__} {source_commit()[:12]}".strip(),
        "Python": ".".join(platform.python_version_tuple()[:2]),
        **{name: version(name) for name in NUMERICAL_LIBRARIES},
    }


def _list_folders(folders: Sequence[Path]) -> list[Any]:
    return list(map(_list_folder, folders))


def _list_folder(folder: Path) -> list[tuple[str, int]] | None:
    """Return names and sizes of the files in a folder, None for a folder that is absent."""
    if not folder.is_dir():
        return None
    return sorted((f.name, f.stat().st_size * f.is_file()) for f in folder.iterdir())
