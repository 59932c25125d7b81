"""A whole protocol on the direct rig, into a session that says that it is simulated."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from rigctl import __version__
from rigctl.config import RigConfig
from rigctl.errors import ProtocolError
from rigctl.protocol import (
    Plan,
    Protocol,
    RunTrial,
    load_protocol,
    parse_protocol,
)
from rigctl.run.opening import check_room
from rigctl.session.header import SessionHeader
from rigctl.session.recorder import Recorder
from rigctl.synth.work import Work
from rigctl.world.parameters import WorldParameters

METHOD = "direct"
GENERATOR = 2
"""Goes up when one seed no longer gives the same session. 2: polls and blocks in batches; the
samples are still those of 1."""

BYTES_PER_SECOND = 62_000
"""Samples, polls, load cell, truth; measured, rounded up."""

_REPEATS = re.compile(r"^repeats\s*=.*$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Order:
    """What data set is wanted. ``seed`` orders the trials and shapes the world."""

    plan: Plan
    seed: int
    folder: Path
    start_utc: str


@dataclass(frozen=True, slots=True)
class Progress:
    """How far it is: trials that ended, how many are committed, seconds of their windows."""

    trials: int
    committed: int
    trial_s: float


def plan_of(path: Path, repeats: int | None, seed: int) -> Plan:
    """The plan of a protocol file with another number of repeats, if one is given.

    The protocol's text says so too, because a session holds it. Raises ProtocolError.
    """
    protocol = load_protocol(path, RigConfig())
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
    order: Order, on_progress: Callable[[Progress], None], stop: Callable[[], bool]
) -> bool:
    """Make the data set; False when ``stop`` ended it between two trials.

    Raises SessionError, DiskFault and BoardFault; what was recorded until then is kept.
    """
    plan = order.plan
    trial_s = sum(trial.duration_s for trial in plan.trials)
    check_room(order.folder, round(1.1 * trial_s * BYTES_PER_SECOND))
    config = plan.protocol.config
    recorder = Recorder(order.folder, _header(order), plan.protocol.text, config.to_toml())
    with recorder:
        work = Work(plan.protocol, order.seed, order.folder, recorder)
        try:
            return _take_steps(work, plan, on_progress, stop)
        finally:
            work.finish()


def _take_steps(
    work: Work, plan: Plan, on_progress: Callable[[Progress], None], stop: Callable[[], bool]
) -> bool:
    trials, trial_s = 0, 0.0
    for step in plan.steps:
        if stop():
            return False
        work.perform(step)
        if isinstance(step, RunTrial):
            trials, trial_s = trials + 1, trial_s + step.trial.duration_s
            on_progress(Progress(trials, work.committed, trial_s))
    return True


def _header(order: Order) -> SessionHeader:
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
        encoder_preset=config.encoder.preset,
        n_taxels=config.taxels.count,
        simulation={
            "seed": order.seed,
            "method": METHOD,
            "generator": GENERATOR,
            "world": asdict(WorldParameters()),
        },
    )
