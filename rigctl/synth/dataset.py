"""Generate a data set: run a protocol on the direct rig and record a simulated session."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from multiprocessing.synchronize import Event
from pathlib import Path

import tomlkit

from rigctl.bench.world_file import NOMINAL_WORLD, SimulatedWorld
from rigctl.engine.run_request import check_disk_space, drum_header
from rigctl.errors import RigctlError, RigFault, WrongUse
from rigctl.protocol.loader import load_protocol, parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.protocol.steps import RunTrial
from rigctl.session.ground_truth import begin_log
from rigctl.session.header import CUT_BY_WIRE, SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.synth.resume import (
    ResumedRecorder,
    UnfinishedSession,
    inspect_session,
    remove_damaged_truth,
)
from rigctl.synth.step_runner import DatasetStepRunner

METHOD = "direct"
GENERATOR = 5
"""Increases when a seed no longer gives the same session. 2: polls and blocks in batches, with the
same samples as 1. 3: samples in the order of the taxels. 4: the boards' own firmware, and another
skin. 5: another noise generator."""

BYTES_PER_SECOND = 67_000
"""Samples, polls, load cell and ground truth; measured, rounded up."""


@dataclass(frozen=True, slots=True)
class DatasetRequest:
    """A data set to generate: ``seed`` and ``world`` determine the bench.

    ``resume`` continues an existing session.
    """

    plan: Plan
    seed: int
    folder: Path
    start_utc: str
    resume: bool = False
    world: SimulatedWorld = NOMINAL_WORLD


@dataclass(frozen=True, slots=True)
class DatasetProgress:
    """Progress: finished trials, how many of them are committed, seconds of their windows."""

    trials: int
    committed: int
    trial_s: float


def load_plan(
    path: Path, repeats: int | None, seed: int, world: SimulatedWorld = NOMINAL_WORLD
) -> Plan:
    """Load a protocol, replace its number of repeats if one is given, and return its plan.

    The text of the protocol changes too, because the session stores it. Raises ProtocolError.
    """
    protocol = load_protocol(path, world.rig_config())
    if protocol.early_end is not None:
        raise WrongUse(
            f"{path}: a virtual data set has every trial of its protocol, so it takes no "
            "[early_end]: remove the table"
        )
    if repeats is not None:
        document = tomlkit.parse(protocol.text)
        document["repeats"] = repeats
        protocol = parse_protocol(document.as_string(), str(path), protocol.config)
    return protocol.plan(seed)


def generate(
    request: DatasetRequest,
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
    workers: int = 1,
) -> bool:
    """Generate the data set; return False if ``stop`` ended it between two trials.

    A resumed session is simulated again from its start, the only way to reach its last state; only
    missing trials are recorded. Raises SessionError, DiskFault and BoardFault; what was recorded
    until then is kept.
    """
    plan, header = request.plan, _header(request)
    folder = request.folder
    found = inspect_session(folder, header, plan) if request.resume else UnfinishedSession()
    trial_s = sum(trial.duration_s for trial in plan.trials)
    if found.complete:
        on_progress(DatasetProgress(len(plan.trials), found.committed, trial_s))
        return True
    left = 1 - len(found.attempts) / max(1, len(plan.trials))
    check_disk_space(folder, round(1.1 * max(0.0, left) * trial_s * BYTES_PER_SECOND))
    exists = bool(found.start_utc)
    header = replace(header, start_utc=found.start_utc) if exists else header
    texts = plan.protocol.text, plan.protocol.config.with_order().to_toml()
    with Recorder(folder, header, *texts, resume=exists) as recorder:
        remove_damaged_truth(folder)
        truth_log = begin_log(folder, (header.start_utc, header.start_loop_s), 0, again=True)
        resumed = ResumedRecorder(recorder, found.attempts, header.wiring)
        runner = DatasetStepRunner(
            plan.protocol, request.world.parameters, request.seed, truth_log, resumed, workers
        )
        with closing(runner):
            return _run_steps(runner, plan, on_progress, stop)


def _run_steps(
    runner: DatasetStepRunner,
    plan: Plan,
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
) -> bool:
    trials, trial_s = 0, 0.0
    for step in plan.steps:
        if stop():
            return False
        runner.run(step)
        if isinstance(step, RunTrial):
            trials, trial_s = trials + 1, trial_s + step.trial.duration_s
            on_progress(DatasetProgress(trials, runner.committed, trial_s))
    return True


def _header(request: DatasetRequest) -> SessionHeader:
    return drum_header(
        request.plan,
        rig="synth",
        simulated=True,
        start_utc=request.start_utc,
        sensor="simulated",
        cut_by=CUT_BY_WIRE,
        simulation={
            "seed": request.seed,
            "method": METHOD,
            "generator": GENERATOR,
            **request.world.header_fields(),
        },
    )


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
