"""Generate a data set as several sessions in parallel, each with its own gains and alignments."""

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
from rigctl.synth.dataset import DatasetProgress, DatasetRequest, generate, load_plan

POLL_S = 0.2
SEED_STRIDE = 1000


def split_request(
    path: Path, repeats: int | None, request: DatasetRequest, sessions: int
) -> list[DatasetRequest]:
    """Split a request into sessions with nearly equal repeats, in subfolders of its folder.

    Session ``i``, counted from 1, has the seed ``1000 × seed + i``. Raises WrongUse if there are
    fewer repeats than sessions.
    """
    total = request.plan.protocol.repeats if repeats is None else repeats
    if not 1 <= sessions <= total:
        raise WrongUse(f"{total} repeats make 1 to {total} sessions, not {sessions}")
    parts = []
    for number in range(1, sessions + 1):
        seed = SEED_STRIDE * request.seed + number
        own_repeats = total // sessions + (number <= total % sessions)
        folder = request.folder / f"session-{number:02d}"
        plan = load_plan(path, own_repeats, seed, request.world)
        parts.append(replace(request, plan=plan, seed=seed, folder=folder))
    return parts


def generate_sessions(
    requests: list[DatasetRequest],
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
    workers: int,
) -> bool:
    """Generate the sessions, ``workers`` at a time; return False if ``stop`` ended them.

    Raises what :func:`generate` raises, after the other sessions have ended.
    """
    return _SessionProcesses(requests, on_progress).run(stop, workers)


class _SessionProcesses:
    """Runs each session in a process of its own."""

    def __init__(
        self, requests: list[DatasetRequest], on_progress: Callable[[DatasetProgress], None]
    ) -> None:
        self._context = multiprocessing.get_context("spawn")
        self._messages: Any = self._context.Queue()
        self._stop = self._context.Event()
        self._pending = list(enumerate(requests))
        self._running: dict[int, BaseProcess] = {}
        self._progress = {number: DatasetProgress(0, 0, 0.0) for number, _ in self._pending}
        self._on_progress = on_progress
        self._failure: RigctlError | None = None
        self._complete = True

    def run(self, stop: Callable[[], bool], workers: int) -> bool:
        while (self._pending and not self._stop.is_set()) or self._running:
            if stop() or self._failure is not None:
                self._stop.set()
            while self._pending and len(self._running) < workers and not self._stop.is_set():
                self._start(*self._pending.pop(0))
            self._receive()
        if self._failure is not None:
            raise self._failure
        return self._complete and not self._pending

    def _start(self, number: int, request: DatasetRequest) -> None:
        arguments = number, request, self._messages, self._stop
        process = self._context.Process(target=_generate_one, args=arguments)
        process.start()
        self._running[number] = process

    def _receive(self) -> None:
        try:
            number, message = self._messages.get(timeout=POLL_S)
        except queue.Empty:
            self._check_exit_codes()
            return
        if isinstance(message, DatasetProgress):
            self._progress[number] = message
            self._report_progress()
            return
        self._running.pop(number).join()
        self._complete = self._complete and message is True
        if isinstance(message, RigctlError):
            self._failure = self._failure or message

    def _report_progress(self) -> None:
        each = self._progress.values()
        trials, committed = sum(p.trials for p in each), sum(p.committed for p in each)
        self._on_progress(DatasetProgress(trials, committed, sum(p.trial_s for p in each)))

    def _check_exit_codes(self) -> None:
        """Detect processes that died without a message."""
        for number, process in list(self._running.items()):
            if process.exitcode:
                del self._running[number]
                self._failure = RigFault(
                    f"session {number + 1} ended with code {process.exitcode}: continue with "
                    "--resume"
                )


def _generate_one(number: int, request: DatasetRequest, messages: Any, stop: Any) -> None:
    """Generate one session in a child process, which leaves Ctrl-C to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        complete = generate(request, lambda done: messages.put((number, done)), stop.is_set)
        messages.put((number, complete))
    except RigctlError as error:
        messages.put((number, error))
