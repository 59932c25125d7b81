"""From an order to run a protocol to what the run needs: plan, session folder, what is done."""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rigctl import __version__
from rigctl.config.resources import find_protocol, source_commit
from rigctl.config.rig_config import RigConfig
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.protocol import Plan, load_protocol
from rigctl.session.format import layout
from rigctl.session.format.header import CUT_BY_CLOCK, CUT_BY_WIRE, SessionHeader
from rigctl.session.read.session import Session
from rigctl.session.write.recorder import Recorder
from rigctl.session.write.session_folder import check_same_world
from rigctl.values import BoardIdentity


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What somebody wants run: a protocol into a new folder, or a session gone on with.

    ``seed`` takes the place of the protocol's own; ``out`` and ``resume`` are folders.
    """

    protocol: str | None = None
    out: str | None = None
    resume: str | None = None
    seed: int | None = None
    yes: bool = False

    def __post_init__(self) -> None:
        if (self.protocol is None) == (self.resume is None):
            raise WrongUse("give a protocol to run, or a session to go on with, not both")


@dataclass(frozen=True, slots=True)
class RunContext:
    """What the engine knows of the rig at the start of a run."""

    config: RigConfig
    rig: str
    simulated: bool
    rig_seed: int
    world: dict[str, Any]
    boards: tuple[BoardIdentity, ...]
    start_utc: str
    start_loop_s: float


@dataclass(frozen=True, slots=True)
class OpenedRun:
    """A session ready to be recorded into."""

    plan: Plan
    recorder: Recorder
    resumed: bool
    done: frozenset[int]
    attempts: dict[int, int]


def open_run(order: RunRequest, bearings: RunContext) -> OpenedRun:
    """Read the protocol, check the disk, lock the folder.

    Raises ProtocolError, SessionError or DiskFault before anything moves.
    """
    if order.resume is not None:
        return _go_on(order, Path(order.resume), bearings)
    assert order.protocol is not None
    plan = load_protocol(find_protocol(order.protocol), bearings.config).plan(order.seed)
    folder = Path(order.out) if order.out else default_folder(plan, bearings.start_utc)
    check_room(folder, plan.bytes_estimate)
    recorder = _recorder(folder, plan, bearings, resume=False)
    return OpenedRun(plan, recorder, False, frozenset(), {})


def default_folder(plan: Plan, start_utc: str) -> Path:
    """Where a session goes when nobody said: below ``sessions`` in the current folder."""
    stamp = start_utc[:19].replace(":", "").replace("T", "-")
    return Path("sessions") / f"{stamp}-{plan.protocol.name}"


def check_room(folder: Path, needed_bytes: int) -> None:
    """Raise DiskFault where the disk of ``folder`` cannot hold what the plan will record."""
    place = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    free = shutil.disk_usage(place).free
    if free < needed_bytes:
        raise DiskFault(
            f"the plan records about {needed_bytes / 1e9:.1f} GB and {place} has room for "
            f"{free / 1e9:.1f} GB: make room, or choose another disk"
        )


def _go_on(order: RunRequest, folder: Path, bearings: RunContext) -> OpenedRun:
    with Session.open(folder) as session:
        seed, tried = session.header.seed, Counter(session.trials["trial_id"].tolist())
        done = frozenset(session.trials["trial_id"][session.committed()].tolist())
        rig, simulation = session.header.rig, session.header.simulation
    if rig != bearings.rig:
        raise SessionError(
            f"{folder} was recorded on the {rig} rig and this is the {bearings.rig} one: "
            "connect the rig that began the session"
        )
    check_same_world(folder, simulation, bearings.world)
    plan = load_protocol(folder / layout.PROTOCOL_FILE, bearings.config).plan(seed)
    if len(done) == len(plan.trials):
        raise SessionError(f"{folder} is complete: every planned trial is committed")
    left = 1 - len(done) / max(1, len(plan.trials))
    check_room(folder, round(left * plan.bytes_estimate))
    recorder = _recorder(folder, plan, bearings, resume=True)
    return OpenedRun(plan, recorder, True, done, dict(tried))


def _recorder(folder: Path, plan: Plan, bearings: RunContext, resume: bool) -> Recorder:
    config = bearings.config
    header = SessionHeader(
        plan_hash=plan.hash,
        seed=plan.seed,
        trials_planned=len(plan.trials),
        rig=bearings.rig,
        simulated=bearings.simulated,
        start_utc=bearings.start_utc,
        start_loop_s=bearings.start_loop_s,
        protocol=plan.protocol.name,
        boards=bearings.boards,
        operator=config.about.operator,
        sensor=config.about.sensor,
        software_version=__version__,
        software_commit=source_commit(),
        encoder_preset=config.encoder.preset,
        n_taxels=config.taxels.count,
        taxel_low=config.taxels.low,
        taxel_high=config.taxels.high,
        wiring=config.taxels.order,
        cut_by=CUT_BY_WIRE if config.signals.sync else CUT_BY_CLOCK,
        simulation={"seed": bearings.rig_seed, **bearings.world} if bearings.simulated else {},
    )
    return Recorder(
        folder, header, plan.protocol.text, config.with_order().to_toml(), resume=resume
    )
