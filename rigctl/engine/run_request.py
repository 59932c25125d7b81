"""A request to run a protocol, and the session that is opened for it."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msgspec import Struct

from rigctl import __version__
from rigctl.config.resources import find_protocol, source_commit
from rigctl.config.text_file import refuse_link_outside
from rigctl.encoder.reading import Reading
from rigctl.engine.rig import Rig
from rigctl.engine.rpc.commands import NameText, NoteText, OwnFields, PathText, Seed
from rigctl.errors import DiskFault, SessionError, WrongUse
from rigctl.protocol.loader import load_protocol
from rigctl.protocol.plan import Plan
from rigctl.session import layout
from rigctl.session.header import (
    CUT_BY_CLOCK,
    CUT_BY_WIRE,
    SessionHeader,
    describe_new_versions,
)
from rigctl.session.recorder import Recorder, check_same_world, history_of, keep_private
from rigctl.session.sensor_layout import SensorLayout
from rigctl.session.session import Session, ended_early
from rigctl.session.writer import SessionHistory
from rigctl.values import ABOUT, BoardIdentity


class SaidOfSession(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What people say of a session at its start, kept in it.

    ``operator`` and ``sensor`` replace those of the rig's file. ``own``: a lab's own fields, such
    as those of ``about.ask``, by their names.
    """

    operator: NameText = ""
    sensor: NameText = ""
    plate_lot: NameText = ""
    project: NameText = ""
    remarks: NoteText = ""
    own: OwnFields = {}

    @property
    def about(self) -> dict[str, Any]:
        """What was said, by attribute; without what was left empty."""
        said = {name: getattr(self, name).strip() for name in ABOUT}
        own = {name: text.strip() for name, text in self.own.items() if text.strip()}
        return {name: value for name, value in {**said, "own": own}.items() if value}


class RunRequest(SaidOfSession, frozen=True, forbid_unknown_fields=True):
    """A protocol to run into a new folder, or a session to resume.

    ``seed`` replaces the protocol's own; ``out`` and ``resume`` are folders; ``yes`` answers
    every question on a simulated rig. ``notes`` becomes the first note of the sitting.
    """

    protocol: PathText | None = None
    out: PathText | None = None
    resume: PathText | None = None
    seed: Seed | None = None
    yes: bool = False
    notes: NoteText = ""

    def __post_init__(self) -> None:
        if (self.protocol is None) == (self.resume is None):
            raise WrongUse("give a protocol to run or a session to resume, not both")


@dataclass(frozen=True, slots=True)
class RunContext:
    """The rig at the start of a run, and what was said ``about`` the session.

    ``is_commissioned``: the drum's board presses for protocols.
    """

    rig: Rig
    boards: tuple[BoardIdentity, ...]
    start_utc: str
    is_commissioned: bool
    about: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class OpenedRun:
    """A plan, the recorder of its session, and the results of earlier sittings.

    ``unattended``: plates change without an operator and questions are skipped. ``done``: trials
    committed before; ``ended``: trials whose conditions ended early; ``attempts``: number of
    previous attempts at each trial. ``missing``: a sentence for each part that cannot be read and
    for trials that are left out.
    """

    plan: Plan
    recorder: Recorder
    unattended: bool
    resumed: bool = False
    done: frozenset[int] = frozenset()
    ended: frozenset[int] = frozenset()
    attempts: Mapping[int, int] = field(default_factory=dict)
    missing: tuple[str, ...] = ()


def open_run(request: RunRequest, context: RunContext) -> OpenedRun:
    """Read the protocol, check the disk and lock the folder.

    Raises ProtocolError, SessionError or DiskFault before anything moves.
    """
    unattended = request.yes and context.rig.simulated
    if request.resume is not None:
        return _resume(Path(request.resume), context, unattended)
    assert request.protocol is not None
    plan = load_protocol(find_protocol(request.protocol), context.rig.config).plan(request.seed)
    _check_plan(plan, context)
    folder = chosen_folder(request.out, context.start_utc, plan.protocol.name)
    check_disk_space(folder, plan.bytes_estimate)
    return OpenedRun(plan, open_recorder(folder, plan, context, resume=False), unattended)


def _check_plan(plan: Plan, context: RunContext) -> None:
    """Raise WrongUse where the board would not press, or an early end could not be judged."""
    if plan.trials and not context.is_commissioned:
        raise WrongUse(
            "the drum's board is not commissioned for its wiring, so it presses for no protocol: "
            "run rigctl setup, or in the window Rig → Set up …; then start the run again"
        )
    _check_early_end(plan)


def _check_early_end(plan: Plan) -> None:
    """Raise WrongUse where rates would depend on trials that are to come."""
    if plan.protocol.early_end is None:
        return
    if plan.protocol.config.encoder.reading != Reading.COUNTS:
        raise WrongUse(
            "early_end needs calibrated ranges, which are in counts: set reading = "
            '"counts" under [encoder] in rig.toml, or remove [early_end]'
        )
    if not plan.protocol.config.taxels.low:
        raise WrongUse(
            "early_end needs the range of the taxels, because rates depend on it: calibrate the "
            "range and write it as low and high under [taxels] into rig.toml, or remove [early_end]"
        )


def chosen_folder(out: str | None, start_utc: str, name: str) -> Path:
    """Return the folder that a request names, by default one below ``sessions``."""
    stamp = start_utc[:19].replace(":", "").replace("T", "-")
    return Path(out) if out else Path("sessions") / f"{stamp}-{name}"


def check_disk_space(folder: Path, needed_bytes: int) -> None:
    """Raise DiskFault where the disk of ``folder`` is too small for the plan's recording."""
    existing = next(path for path in (folder, *folder.absolute().parents) if path.is_dir())
    free = shutil.disk_usage(existing).free
    if free < needed_bytes:
        raise DiskFault(
            f"the plan records about {needed_bytes / 1e6:,.0f} MB and {existing} has room for "
            f"{free / 1e6:,.0f} MB: make room, or choose another disk"
        )


def _resume(folder: Path, context: RunContext, unattended: bool) -> OpenedRun:
    rig = context.rig
    with Session.open(folder) as session:
        header, attempts = session.header, Counter(session.trials["trial_id"].tolist())
        before = session.parts[-1].header
        done = frozenset(session.trials["trial_id"][session.committed()].tolist())
        missing = tuple(session.describe_missing())
        ended = frozenset(ended_early(session))
        known = history_of(session, folder)
    check_same_rig(folder, header, rig.kind, rig.world)
    _check_sensor(folder, header, context)
    refuse_link_outside(folder / layout.PROTOCOL_FILE)
    plan = load_protocol(folder / layout.PROTOCOL_FILE, rig.config).plan(header.seed)
    if len(done) + len(ended) == len(plan.trials):
        why = "every planned trial is committed" + (
            ", or its condition ended early" if ended else ""
        )
        raise SessionError(f"{folder} is complete: {why}")
    _check_plan(plan, context)
    remaining = 1 - (len(done) + len(ended)) / max(1, len(plan.trials))
    check_disk_space(folder, round(remaining * plan.bytes_estimate))
    recorder = open_recorder(folder, plan, context, resume=True, known=known)
    missing += tuple(describe_new_versions(before, recorder.header))
    return OpenedRun(plan, recorder, unattended, True, done, ended, attempts, missing)


def check_same_rig(folder: Path, header: SessionHeader, kind: str, world: dict[str, Any]) -> None:
    """Raise SessionError where another rig or simulated world began the session."""
    if header.rig != kind:
        raise SessionError(
            f"{folder} was recorded on the {header.rig} rig and this is the {kind} one: "
            "connect the rig that began the session"
        )
    check_same_world(folder, header.simulation, world)


def _check_sensor(folder: Path, header: SessionHeader, context: RunContext) -> None:
    """Raise SessionError where the session and this rig name two sensors."""
    sensor = context.about.get("sensor") or context.rig.config.about.sensor
    if header.sensor and sensor and sensor != header.sensor:
        raise SessionError(
            f"{folder} was recorded with the sensor {header.sensor!r}, this rig has {sensor!r}: "
            "resume it with its own (name it as at the start), or start a new session"
        )


def open_recorder(
    folder: Path,
    plan: Plan,
    context: RunContext,
    resume: bool,
    known: SessionHistory | None = None,
) -> Recorder:
    """Lock the folder and return the recorder of a session that runs this plan."""
    rig, config = context.rig, context.rig.config
    about = {"operator": config.about.operator, "sensor": config.about.sensor, **context.about}
    header = drum_header(
        plan,
        **about,
        rig=rig.kind,
        simulated=rig.simulated,
        start_utc=context.start_utc,
        start_loop_s=rig.loop.time(),
        boards=context.boards,
        taxel_low=config.taxels.low,
        taxel_high=config.taxels.high,
        cut_by=CUT_BY_WIRE if config.signals.sync else CUT_BY_CLOCK,
        simulation={"seed": rig.seed, **rig.world} if rig.simulated else {},
        passport=rig.passport.to_values() if rig.passport else {},
        plugins=rig.plugins,
    )
    if config.recording.private:
        keep_private(folder)
    rig_text = config.with_order().to_toml()
    return Recorder(folder, header, plan.protocol.text, rig_text, resume=resume, known=known)


def drum_header(plan: Plan, **fields: Any) -> SessionHeader:
    """Return the header of a session that runs this plan with this program.

    ``fields``: the others of :class:`SessionHeader`, which depend on the rig.
    """
    config = plan.protocol.config
    return session_header(
        plan,
        encoder_preset=config.encoder.preset,
        encoder_reading=config.encoder.reading,
        encoder_scaling=config.encoder.force_scaling,
        n_taxels=config.taxels.count,
        sample_unit=f"ADC counts, 0–{config.taxels.full_scale}",
        highest_reading=config.taxels.full_scale,
        wiring=config.taxels.order,
        sensor_layout=SensorLayout.of_rig(config.taxels),
        **fields,
    )


def session_header(plan: Any, **fields: Any) -> SessionHeader:
    """Return a header with what the plan of any experiment and this program say."""
    return SessionHeader(
        plan_hash=plan.hash,
        seed=plan.seed,
        trials_planned=len(plan.trials),
        protocol=plan.protocol.name,
        software_version=__version__,
        software_commit=source_commit(),
        **fields,
    )
