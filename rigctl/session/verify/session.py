"""Prove a session whole: every sample, gap and trial is where the tables say that it is.

A *problem* makes the answer no. A *note* is worth knowing and harms nothing: a part whose
writer was killed and whose session went on, trials that are not recorded yet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.errors import RigctlError, SessionError
from rigctl.protocol import Plan, parse_protocol
from rigctl.session.files.ground_truth import PATTERN, summary
from rigctl.session.format import layout
from rigctl.session.format.wiring import wiring_of
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.read.part import PartReader
from rigctl.session.read.session import Session
from rigctl.session.verify.part import check_part
from rigctl.session.verify.trials import check_trials
from rigctl.values import TrialRow, Verdict

WORLD = "the world's own log"
WORLD_SHARE = 0.5
"""Of the work, as measured: that log is compressed, the parts are not."""
TOLD_TRIALS = 500

SAME_IN_ALL_PARTS = ("plan_hash", "seed", "trials_planned", "n_taxels", "sample_rate_hz")


@dataclass(slots=True)
class VerifyReport:
    """What was found. One line a problem, each beginning with the file it is in."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    samples: int = 0
    trials_committed: int = 0
    lost_samples: int = 0

    @property
    def whole(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems


OnStep = Callable[[float, str], None]


def verify(path: Path, on_step: OnStep = lambda share, what: None) -> VerifyReport:
    """Check everything in a session. Raises SessionError for a folder that is none.

    ``on_step`` is told which share of the work is done, 0 to 1, and what comes next. However
    long a session is, no more than a stretch of its samples is held.
    """
    report = VerifyReport()
    try:
        session = Session.open(path)
    except SessionError as error:
        if not list(path.glob(layout.PART_PATTERN)):
            raise
        report.problems.append(str(error))
        return report
    with session:
        try:
            _check_session(session, report, on_step)
        except SessionError as error:
            report.problems.append(str(error))
    return report


def _check_session(session: Session, report: VerifyReport, on_step: OnStep) -> None:
    _check_parts(session, report)
    rows = [session.trial_row(index) for index in range(len(session.trials))]
    n_parts, of_parts = len(session.parts), _share_of_parts(session)
    for done, part in enumerate(session.parts):
        on_step(of_parts * done / n_parts, f"part {done + 1} of {n_parts}")
        own = [row for row in rows if row.part == part.number]
        problems, notes = check_trials(part, own)
        problems = check_part(part) + problems
        report.problems += [f"{part.path.name}: {line}" for line in problems]
        report.notes += [f"{part.path.name}: {line}" for line in notes]
    on_step(of_parts, "the plan")
    _check_plan(session, rows, report)
    _check_world(session, report, lambda share: on_step(share, WORLD), of_parts)
    report.samples = session.n_samples
    report.lost_samples = int(session.gaps["count"].sum())


def _share_of_parts(session: Session) -> float:
    """How much of the work the parts are: the rest is the world's own log, where there is one."""
    return 1.0 - WORLD_SHARE if list(session.path.glob(PATTERN)) else 1.0


def _check_parts(session: Session, report: VerifyReport) -> None:
    numbers = [part.number for part in session.parts]
    if numbers != list(range(1, len(numbers) + 1)):
        missing = sorted(set(range(1, max(numbers) + 1)) - set(numbers))
        report.problems.append(f"parts are missing: {', '.join(map(layout.part_name, missing))}")
    for part in session.parts:
        _check_header(session, part, report)
        if part.finished:
            continue
        if part is not session.parts[-1]:
            report.notes.append(f"{part.path.name}: was not closed in order, the session went on")
        elif is_being_written(session.path):
            report.problems.append(f"{part.path.name}: is still being written")
        else:
            report.problems.append(
                f"{part.path.name}: was not closed in order, its writer was killed or could "
                "not write; what it committed is kept, go on with --resume of the command that "
                "made it"
            )


def _check_header(session: Session, part: PartReader, report: VerifyReport) -> None:
    if part.attributes.get("part") != part.number:
        report.problems.append(f"{part.path.name}: says that it is part {part.attributes['part']}")
    for name in SAME_IN_ALL_PARTS:
        if getattr(part.header, name) != getattr(session.header, name):
            report.problems.append(f"{part.path.name}: has another {name} than the first part")
    if wiring_of(part.header, part.text("/rig_toml")) != session.wiring:
        report.problems.append(f"{part.path.name}: has its taxels in another order than the first")


def _check_plan(session: Session, rows: list[TrialRow], report: VerifyReport) -> None:
    """Each committed trial once, and as it was planned."""
    committed = [row for row in rows if row.verdict is Verdict.COMMITTED]
    counts = Counter(row.trial.trial_id for row in committed)
    report.trials_committed = len(counts)
    report.problems += [
        f"trial {number} is committed {count} times"
        for number, count in counts.items()
        if count > 1
    ]
    plan = _plan_of(session, report)
    if plan is not None:
        planned = {trial.trial_id: trial for trial in plan.trials}
        for row in rows:
            if planned.get(row.trial.trial_id) != row.trial:
                name = layout.part_name(row.part)
                report.problems.append(f"{name}: trial {row.trial.trial_id} is not in the plan")
    missing = session.header.trials_planned - len(counts)
    if missing > 0:
        report.notes.append(
            f"{missing} of {session.header.trials_planned} planned trials are not committed"
        )


def _plan_of(session: Session, report: VerifyReport) -> Plan | None:
    """The plan made anew from the protocol and the seed; its hash must be the recorded one."""
    if not session.protocol_text:
        report.notes.append("the session has no protocol, so its trials have no plan")
        return None
    try:
        protocol = parse_protocol(session.protocol_text, layout.PROTOCOL_FILE, session.config)
    except RigctlError as error:
        report.problems.append(f"the protocol in the session cannot be read: {error}")
        return None
    plan = protocol.plan(session.header.seed)
    if plan.hash != session.header.plan_hash:
        report.problems.append("the plan hash is not that of the protocol and seed in the session")
        return None
    return plan


def _check_world(
    session: Session, report: VerifyReport, on_share: Callable[[float], None], begun: float
) -> None:
    def on_trial(done: int, trials: int) -> None:
        if done % TOLD_TRIALS == 0:
            on_share(begun + (1.0 - begun) * done / trials)

    try:
        world = summary(session, on_trial)
    except SessionError as error:
        report.problems.append(str(error))
        return
    if world is None:
        if session.header.simulated:
            report.notes.append("recorded at a simulated bench; the world's own log is not there")
        return
    if not world["trials"]:
        report.notes.append("recorded at a simulated bench; its world saw no committed trial")
        return
    report.notes.append(
        f"recorded at a simulated bench; its world saw {world['trials']} trials, largest error "
        f"{world['max_speed_error_permille']} ‰ in speed, {world['max_force_error_permille']} ‰ "
        "in force"
    )
