"""A crew of Dask workers, on this machine or others. The only place that knows Dask."""

from __future__ import annotations

import logging
import platform
import socket
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from threadpoolctl import threadpool_info

from rigctl import __version__
from rigctl.analysis.execution.executor import Executor, Job, Result, one_blas_thread
from rigctl.config.resources import source_commit
from rigctl.errors import WorkersLost, WrongUse

CONNECT_S = 10.0
AHEAD = 4
"""Jobs handed out for each thread of the workers, so that none waits for this process."""
LOOK_EVERY_S = 5.0
LOOKS_WITHOUT_WORKERS = 12
ROUNDING = ("numpy", "scipy", "numba", "scikit-learn")
"""Libraries whose other version may give other bits."""
# A draw names every trial of the set, which Dask would take for data sent by mistake.
CONFIG = {"distributed.admin.large-graph-warning-threshold": "1GB"}

Versions = tuple[tuple[str, str], ...]
Listings = dict[str, tuple[tuple[str, int], ...] | None]


class WorkerBuild(NamedTuple):
    """What decides on a process's bits, and on which machine it runs."""

    versions: Versions
    kernels: str
    host: str


class DaskExecutor:
    """Workers of one scheduler; made by :func:`dask_executor`. They may come, die and come back."""

    def __init__(self, client: Any, builds: Mapping[str, WorkerBuild]) -> None:
        self._client = client
        self._builds = builds
        self._scheduler = str(client.scheduler.address)

    @property
    def shares_disk(self) -> bool:
        """Whether all workers run on this machine."""
        return {build.host for build in self._builds.values()} == {_build().host}

    @property
    def remarks(self) -> tuple[str, ...]:
        """A sentence where a worker's processor may round otherwise than this machine's."""
        ours = _build().kernels
        for name, build in self._builds.items():
            if build.kernels != ours:
                return (
                    f"Dask worker {name} computes with {build.kernels}, this machine with {ours}: "
                    "last bits may differ from those of a single process",
                )
        return ()

    def must_see(self, folders: Sequence[Path]) -> None:
        """Raises WrongUse where a worker does not see a folder as this process does."""
        ours = _listings(folders)
        for name, theirs in _asked(self._client, _listings, list(folders)).items():
            for folder, files in theirs.items():
                if files is None:
                    raise WrongUse(
                        f"Dask worker {name} does not see {folder}: keep sessions and report in "
                        "a shared folder that has the same path on every worker"
                    )
                if files != ours[folder]:
                    raise WrongUse(
                        f"Dask worker {name} sees other files in {folder} than this machine does: "
                        "share the folder, and let a session end first that is being written"
                    )

    def map(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """Raises CrewLost where scheduler or workers are gone for good.

        The job of a worker that dies is done by another. What is still to be done when the
        iterator is closed is cancelled.
        """
        todo, waiting = iter(jobs), deque[Any]()
        try:
            with self._reachable():
                ahead = AHEAD * max(1, sum(self._client.nthreads().values()))
            for _ in jobs:
                with self._reachable():
                    for job in islice(todo, ahead - len(waiting)):
                        waiting.append(self._submitted(work, job))
                yield self._result(waiting[0])
                waiting.popleft().release()
        finally:
            if waiting and self._client.status == "running":
                self._client.cancel(list(waiting), force=True)

    def map_unlocked(self, work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[Result]:
        """As :meth:`map`: workers may have threads."""
        return self.map(work, jobs)

    def _submitted(self, work: Callable[[Job], Result], job: Job) -> Any:
        # The version goes with each job, as a worker may have joined after the first look.
        return self._client.submit(_done, work, job, _build().versions, pure=False)

    def _result(self, future: Any) -> Any:
        """The result of one future, with a look at the workers while it takes long."""
        for _ in range(LOOKS_WITHOUT_WORKERS):
            while True:
                with self._reachable(future):
                    try:
                        return future.result(timeout=LOOK_EVERY_S)
                    except TimeoutError:
                        if future.status == "error":
                            raise
                    if not self._client.nthreads():
                        break
        raise WorkersLost(
            f"the Dask scheduler {self._scheduler} has had no worker for "
            f"{LOOK_EVERY_S * LOOKS_WITHOUT_WORKERS:g} s: start some and repeat the analysis"
        )

    @contextmanager
    def _reachable(self, future: Any = None) -> Iterator[None]:
        """Turn what Dask raises for lost machines into words; a job's own errors pass."""
        from distributed.client import ClosedClientError, FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            yield
        except KilledWorker as error:
            raise WorkersLost(
                f"a piece of the analysis brought {error.allowed_failures + 1} Dask workers down, "
                "perhaps for want of memory: give each more, or fewer threads"
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
    """The workers of the scheduler at ``address``, such as tcp://host:8786.

    Raises WrongUse where Dask is not installed, nobody answers, there is no worker, or a worker
    has other versions than this process.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise WrongUse("--dask needs Dask: pip install 'rigctl[dask]'") from None
    _check_answers(address)
    # Its own words would come between ours, and before the sentence that says the same.
    logger = logging.getLogger("distributed.client")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    with dask.config.set(CONFIG):
        client = distributed.Client(address, set_as_default=False, timeout=CONNECT_S)
        try:
            yield DaskExecutor(client, _equal_builds(client, address))
        finally:
            client.close()
            logger.setLevel(level)


def _check_answers(address: str) -> None:
    """A plain connection first: Dask's own failed start leaves a thread behind."""
    cure = "name a scheduler, as --dask tcp://host:8786 (dask scheduler starts one)"
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if parts.scheme not in ("tcp", "tls") or not host or not port:
        raise WrongUse(f"{address!r} is no address of a Dask scheduler: {cure}")
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except OSError as error:
        raise WrongUse(f"nobody answers at {address} ({error}): {cure}") from error


def _equal_builds(client: Any, address: str) -> dict[str, WorkerBuild]:
    """The builds of all workers. Raises WrongUse where there is none, or one of other versions."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise WrongUse(
            f"the Dask scheduler {address} has no workers: start some (dask worker {address})"
        ) from None
    builds: dict[str, WorkerBuild] = _asked(client, _build)
    for name, build in builds.items():
        _check_versions(build.versions, _build().versions, name)
    return builds


def _asked(client: Any, question: Callable[..., Any], *args: Any) -> dict[str, Any]:
    """Every worker's answer, by its name."""
    answers: dict[str, Any] = client.run(question, *args, on_error="return")
    for name, answer in answers.items():
        if isinstance(answer, Exception):
            raise WrongUse(
                f"Dask worker {name} cannot work for rigctl ({answer}): install rigctl "
                f"{__version__} there"
            ) from answer
    return answers


def _check_versions(theirs: Versions, ours: Versions, name: str) -> None:
    for (what, their), (_, our) in zip(theirs, ours, strict=True):
        if their != our:
            raise WrongUse(
                f"Dask worker {name} has {what} {their}, this machine {our}: results would not be "
                "equal, install the same there"
            )


def _done(work: Callable[[Job], Result], job: Job, versions: Versions) -> Result:
    """In a worker: the job, with one thread for linear algebra and the versions of who asks."""
    from distributed import get_worker

    _one_blas_thread()
    _check_versions(_build().versions, versions, get_worker().address)
    return work(job)


@cache
def _one_blas_thread() -> None:
    # For good, as the limit is the process's: jobs in other threads would feel it lifted.
    one_blas_thread()


@cache
def _build() -> WorkerBuild:
    """Of this process, with every BLAS loaded that an analysis uses."""
    import scipy.linalg  # noqa: F401
    from llvmlite.binding import get_host_cpu_name

    commit = source_commit()
    own = f"{__version__} {commit[:12]}".strip()
    python = ".".join(platform.python_version_tuple()[:2])
    versions = [("rigctl", own), ("Python", python), *((n, version(n)) for n in ROUNDING)]
    blas = {
        f"{pool['internal_api']} {pool['version']} for {pool.get('architecture', 'any')}"
        for pool in threadpool_info()
        if pool["user_api"] == "blas"
    }
    kernels = [*sorted(blas), f"Numba for {get_host_cpu_name()}"]
    return WorkerBuild(tuple(versions), ", ".join(kernels), socket.gethostname())


def _listings(folders: Sequence[Path]) -> Listings:
    """Names and sizes of the files in each folder, None for a folder that is not there."""
    return {str(folder): _listing(folder) for folder in folders}


def _listing(folder: Path) -> tuple[tuple[str, int], ...] | None:
    if not folder.is_dir():
        return None
    return tuple(sorted((f.name, f.stat().st_size * f.is_file()) for f in folder.iterdir()))
