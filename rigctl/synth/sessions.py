"""A data set in several sessions, as over several days: each with gains of its own, in parallel."""

from __future__ import annotations

import multiprocessing
import queue
import signal
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from rigctl.errors import RigctlError, RigFault, WrongUse
from rigctl.synth.dataset import DatasetProgress, DatasetRequest, generate, plan_of

LOOK_EVERY_S = 0.2
SEEDS_APART = 1000


def orders(
    path: Path, repeats: int | None, order: DatasetRequest, sessions: int
) -> list[DatasetRequest]:
    """The order split: repeats as evenly as they go, each session below the order's folder.

    Session ``i``, counted from 1, has the seed ``1000 × seed + i``. Raises WrongUse where there
    are fewer repeats than sessions.
    """
    total = order.plan.protocol.repeats if repeats is None else repeats
    if not 1 <= sessions <= total:
        raise WrongUse(f"{total} repeats make 1 to {total} sessions, not {sessions}")
    split = []
    for number in range(1, sessions + 1):
        seed = SEEDS_APART * order.seed + number
        own = total // sessions + (number <= total % sessions)
        folder = order.folder / f"session-{number:02d}"
        plan = plan_of(path, own, seed, order.world)
        split.append(replace(order, plan=plan, seed=seed, folder=folder))
    return split


def generate_all(
    wanted: list[DatasetRequest],
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
    workers: int,
) -> bool:
    """Make every session, at most ``workers`` at a time; False when ``stop`` ended it.

    Raises what :func:`generate` raises, when the others have ended.
    """
    return _SessionProcesses(wanted, on_progress).work(stop, workers)


class _SessionProcesses:
    """One process a session."""

    def __init__(
        self, wanted: list[DatasetRequest], on_progress: Callable[[DatasetProgress], None]
    ) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._news: Any = self._context.Queue()
        self._halt = self._context.Event()
        self._waiting = list(enumerate(wanted))
        self._at_work: dict[int, BaseProcess] = {}
        self._told = {number: DatasetProgress(0, 0, 0.0) for number, _ in self._waiting}
        self._on_progress = on_progress
        self._failure: RigctlError | None = None
        self._whole = True

    def work(self, stop: Callable[[], bool], workers: int) -> bool:
        while (self._waiting and not self._halt.is_set()) or self._at_work:
            if stop() or self._failure is not None:
                self._halt.set()
            while self._waiting and len(self._at_work) < workers and not self._halt.is_set():
                self._start(*self._waiting.pop(0))
            self._hear()
        if self._failure is not None:
            raise self._failure
        return self._whole and not self._waiting

    def _start(self, number: int, order: DatasetRequest) -> None:
        process = self._context.Process(target=_make, args=(number, order, self._news, self._halt))
        process.start()
        self._at_work[number] = process

    def _hear(self) -> None:
        try:
            number, news = self._news.get(timeout=LOOK_EVERY_S)
        except queue.Empty:
            self._bury()
            return
        if isinstance(news, DatasetProgress):
            self._told[number] = news
            self._tell()
            return
        self._at_work.pop(number).join()
        self._whole = self._whole and news is True
        if isinstance(news, RigctlError):
            self._failure = self._failure or news

    def _tell(self) -> None:
        told = self._told.values()
        trials, committed = sum(p.trials for p in told), sum(p.committed for p in told)
        self._on_progress(DatasetProgress(trials, committed, sum(p.trial_s for p in told)))

    def _bury(self) -> None:
        """A process that died without a word."""
        for number, process in list(self._at_work.items()):
            if process.exitcode:
                del self._at_work[number]
                self._failure = RigFault(
                    f"session {number + 1} ended with code {process.exitcode}: continue with "
                    "--resume"
                )


def _make(number: int, order: DatasetRequest, news: Any, halt: Any) -> None:
    """One session, in a process of its own that leaves Ctrl-C to the one above it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        whole = generate(order, lambda progress: news.put((number, progress)), halt.is_set)
        news.put((number, whole))
    except RigctlError as error:
        news.put((number, error))
