"""A whole protocol on the direct rig, into a session that says that it is simulated."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rigctl import __version__
from rigctl.acquisition.protocol.run_request import check_room
from rigctl.config.resources import source_commit
from rigctl.errors import ProtocolError
from rigctl.protocol import (
    Plan,
    Protocol,
    RunTrial,
    load_protocol,
    parse_protocol,
)
from rigctl.session.format.header import CUT_BY_WIRE, SessionHeader
from rigctl.session.write.recorder import Recorder
from rigctl.simulation.bench.world_file import NOMINAL, SimulatedWorld
from rigctl.synth.resumed_recorder import ResumedRecorder
from rigctl.synth.step_runner import DatasetStepRunner
from rigctl.synth.unfinished_session import UnfinishedSession, forget_damaged_truth, look

METHOD = "direct"
GENERATOR = 5
"""Goes up when one seed no longer gives the same session. 2: polls and blocks in batches; the
samples are still those of 1. 3: the taxels stand in their places. 4: the boards'
own firmware, under another skin. 5: noise of another generator."""

BYTES_PER_SECOND = 62_000
"""Samples, polls, load cell, truth; measured, rounded up."""

_REPEATS = re.compile(r"^repeats\s*=.*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class DatasetRequest:
    """What data set is wanted. ``seed`` orders the trials, it and ``world`` shape the bench.

    With ``resume`` a session that is there is gone on with.
    """

    plan: Plan
    seed: int
    folder: Path
    start_utc: str
    resume: bool = False
    world: SimulatedWorld = NOMINAL


@dataclass(frozen=True, slots=True)
class DatasetProgress:
    """How far it is: trials that ended, how many are committed, seconds of their windows."""

    trials: int
    committed: int
    trial_s: float


def plan_of(path: Path, repeats: int | None, seed: int, world: SimulatedWorld = NOMINAL) -> Plan:
    """The plan of a protocol file with another number of repeats, if one is given.

    The protocol's text says so too, because a session holds it. Raises ProtocolError.
    """
    protocol = load_protocol(path, world.description())
    if repeats is not None:
        protocol = _with_repeats(protocol, repeats, str(path))
    return protocol.plan(seed)


def _with_repeats(protocol: Protocol, repeats: int, name: str) -> Protocol:
    text, found = _REPEATS.subn(f"repeats = {repeats}", protocol.text, count=1)
    if not found:
        text = f"repeats = {repeats}\n{protocol.text}"
    changed = parse_protocol(text, name, protocol.config)
    if changed.repeats != repeats:
        raise ProtocolError(f"{name}: write repeats on a line of its own to change it")
    return changed


def generate(
    order: DatasetRequest,
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
    workers: int = 1,
) -> bool:
    """Make the data set; False when ``stop`` ended it between two trials.

    A session that is gone on with is run again from its start, because the world has no other
    way to where it was; only what is missing is recorded. Raises SessionError, DiskFault and
    BoardFault; what was recorded until then is kept.
    """
    plan, header = order.plan, _header(order)
    found = look(order.folder, header, plan) if order.resume else UnfinishedSession()
    trial_s = sum(trial.duration_s for trial in plan.trials)
    if found.complete:
        on_progress(DatasetProgress(len(plan.trials), found.committed, trial_s))
        return True
    left = 1 - found.attempts / max(1, len(plan.trials))
    check_room(order.folder, round(1.1 * max(0.0, left) * trial_s * BYTES_PER_SECOND))
    there = bool(found.start_utc)
    header = replace(header, start_utc=found.start_utc) if there else header
    texts = plan.protocol.text, plan.protocol.config.with_order().to_toml()
    with Recorder(order.folder, header, *texts, resume=there) as recorder:
        forget_damaged_truth(order.folder)
        sink = ResumedRecorder(recorder, found.attempts, header.wiring)
        parameters = order.world.parameters
        work = DatasetStepRunner(plan.protocol, parameters, order.seed, order.folder, sink, workers)
        try:
            return _take_steps(work, plan, on_progress, stop)
        finally:
            work.finish()


def _take_steps(
    work: DatasetStepRunner,
    plan: Plan,
    on_progress: Callable[[DatasetProgress], None],
    stop: Callable[[], bool],
) -> bool:
    trials, trial_s = 0, 0.0
    for step in plan.steps:
        if stop():
            return False
        work.perform(step)
        if isinstance(step, RunTrial):
            trials, trial_s = trials + 1, trial_s + step.trial.duration_s
            on_progress(DatasetProgress(trials, work.committed, trial_s))
    return True


def _header(order: DatasetRequest) -> SessionHeader:
    plan, config = order.plan, order.plan.protocol.config
    return SessionHeader(
        plan_hash=plan.hash,
        seed=plan.seed,
        trials_planned=len(plan.trials),
        rig="synth",
        simulated=True,
        start_utc=order.start_utc,
        protocol=plan.protocol.name,
        sensor="simulated",
        software_version=__version__,
        software_commit=source_commit(),
        encoder_preset=config.encoder.preset,
        n_taxels=config.taxels.count,
        wiring=config.taxels.order,
        cut_by=CUT_BY_WIRE,
        simulation={
            "seed": order.seed,
            "method": METHOD,
            "generator": GENERATOR,
            **order.world.facts(),
        },
    )
