"""Generate a data set as several sessions in parallel, each with its own gains and alignments."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from multiprocessing.synchronize import Event
from pathlib import Path

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
    context = multiprocessing.get_context("spawn")
    stopping = context.Event()
    progress = [DatasetProgress(0, 0, 0.0)] * len(requests)

    def run(number: int) -> bool:
        if stopping.is_set():
            return False
        report = partial(progress.__setitem__, number)
        return _run_process(context, number, requests[number], stopping, report)

    with ThreadPoolExecutor(workers) as executor:
        sessions = [executor.submit(run, number) for number in range(len(requests))]
        pending = set(sessions)
        while pending:
            done, pending = wait(pending, POLL_S)
            if stop() or any(session.exception() for session in done):
                stopping.set()
            total = _total(progress)
            if total.trials:
                on_progress(total)
    complete = [session.result() for session in sessions]
    return all(complete)


def _run_process(
    context: SpawnContext,
    number: int,
    request: DatasetRequest,
    stopping: Event,
    report: Callable[[DatasetProgress], None],
) -> bool:
    """Generate one session in a separate process. Raises RigFault where the process dies."""
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_generate_one, args=(request, sender, stopping))
    process.start()
    sender.close()
    try:
        while isinstance(message := receiver.recv(), DatasetProgress):
            report(message)
    except EOFError as error:
        process.join()
        raise RigFault(
            f"session {number + 1} ended with code {process.exitcode}: continue with --resume"
        ) from error
    process.join()
    if isinstance(message, RigctlError):
        raise message
    return bool(message)


def _total(progress: list[DatasetProgress]) -> DatasetProgress:
    trials, committed = sum(p.trials for p in progress), sum(p.committed for p in progress)
    return DatasetProgress(trials, committed, sum(p.trial_s for p in progress))


def _generate_one(request: DatasetRequest, sender: Connection, stopping: Event) -> None:
    """Generate one session in a child process, which leaves Ctrl-C to its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        sender.send(generate(request, sender.send, stopping.is_set))
    except RigctlError as error:
        sender.send(error)
