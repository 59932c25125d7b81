"""Verify a session: every sample, gap and trial agrees with the tables.

A *problem* fails the check. A *note* is harmless: a part whose writer was killed before another
continued the session, or trials that are not recorded yet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.errors import RigctlError, SessionError
from rigctl.protocol.loader import parse_protocol
from rigctl.protocol.plan import Plan
from rigctl.session.files.ground_truth import TRUTH_PATTERN, summarise_truth
from rigctl.session.format import layout
from rigctl.session.format.wiring import session_wiring
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import part_paths
from rigctl.session.read.session import Session
from rigctl.session.verify.part import check_part
from rigctl.values import TrialRow, Verdict

WORLD = "the world's own log"
TRUTH_SHARE = 0.5
"""Measured share of the work if there is such a log: it is compressed, the parts are not."""
PROGRESS_INTERVAL_TRIALS = 500

SAME_IN_ALL_PARTS = ("plan_hash", "seed", "trials_planned", "n_taxels", "sample_rate_hz")


@dataclass(slots=True)
class VerifyReport:
    """Findings of :func:`verify`; a problem is one line that begins with the file's name."""

    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    samples: int = 0
    trials_committed: int = 0
    lost_samples: int = 0

    @property
    def whole(self) -> bool:
        """Whether there is no problem."""
        return not self.problems


OnProgress = Callable[[float, str], None]


def verify(path: Path, on_progress: OnProgress = lambda share, what: None) -> VerifyReport:
    """Check everything in a session. Raises SessionError for another kind of folder.

    Calls ``on_progress`` with the share of the work done, 0 to 1, and the next step. Holds one
    block of samples at a time, however long the session is.
    """
    report = VerifyReport()
    part_paths(path)  # raises SessionError for another kind of folder
    try:
        with Session.open(path) as session:
            _check_session(session, report, on_progress)
    except SessionError as error:
        report.problems.append(str(error))
    return report


def _check_session(session: Session, report: VerifyReport, on_progress: OnProgress) -> None:
    _check_parts(session, report)
    rows = [session.trial_row(index) for index in range(len(session.trials))]
    n_parts = len(session.parts)
    parts_share = 1.0 - TRUTH_SHARE if list(session.path.glob(TRUTH_PATTERN)) else 1.0
    for done, part in enumerate(session.parts):
        on_progress(parts_share * done / n_parts, f"part {done + 1} of {n_parts}")
        own = [row for row in rows if row.part == part.number]
        problems, notes = check_part(part, own)
        report.problems += [f"{part.path.name}: {line}" for line in problems]
        report.notes += [f"{part.path.name}: {line}" for line in notes]
    on_progress(parts_share, "the plan")
    _check_plan(session, rows, report)
    _check_truth(session, report, on_progress, parts_share)
    report.samples = session.n_samples
    report.lost_samples = int(session.gaps["count"].sum())


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
            report.notes.append(
                f"{part.path.name}: was not closed properly, a later part continues the session"
            )
        elif is_being_written(session.path):
            report.problems.append(f"{part.path.name}: is still being written")
        else:
            report.problems.append(
                f"{part.path.name}: was not closed properly, its writer was killed or could "
                "not write; committed trials are safe, continue with --resume of the command that "
                "made it"
            )


def _check_header(session: Session, part: PartReader, report: VerifyReport) -> None:
    number = part.attributes.get("part")
    if number != part.number:
        report.problems.append(f"{part.path.name}: claims to be part {number}")
    for name in SAME_IN_ALL_PARTS:
        if getattr(part.header, name) != getattr(session.header, name):
            report.problems.append(f"{part.path.name}: has another {name} than the first part")
    if session_wiring(part.header, part.text("/rig_toml")) != session.wiring:
        report.problems.append(f"{part.path.name}: has its taxels in another order than the first")


def _check_plan(session: Session, rows: list[TrialRow], report: VerifyReport) -> None:
    """Check that each committed trial occurs once and matches the plan."""
    committed = [row for row in rows if row.verdict is Verdict.COMMITTED]
    counts = Counter(row.trial.trial_id for row in committed)
    report.trials_committed = len(counts)
    report.problems += [
        f"trial {number} is committed {count} times"
        for number, count in counts.items()
        if count > 1
    ]
    plan = _rebuild_plan(session, report)
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


def _rebuild_plan(session: Session, report: VerifyReport) -> Plan | None:
    """Return the plan from the protocol and seed; its hash must match the recorded one."""
    if not session.protocol_text:
        report.notes.append("the session has no protocol, so its trials have no plan")
        return None
    try:
        protocol = parse_protocol(session.protocol_text, layout.PROTOCOL_FILE, session.config)
    except RigctlError as error:
        report.problems.append(f"the protocol in the session is not readable: {error}")
        return None
    plan = protocol.plan(session.header.seed)
    if plan.hash != session.header.plan_hash:
        report.problems.append("the plan hash does not match the session's protocol and seed")
        return None
    return plan


def _check_truth(
    session: Session, report: VerifyReport, on_progress: OnProgress, done_share: float
) -> None:
    def on_trial(done: int, trials: int) -> None:
        if done % PROGRESS_INTERVAL_TRIALS == 0:
            on_progress(done_share + (1.0 - done_share) * done / trials, WORLD)

    try:
        truth = summarise_truth(session, on_trial)
    except SessionError as error:
        report.problems.append(str(error))
        return
    if truth is None:
        if session.header.simulated:
            report.notes.append("recorded at a simulated bench; the world's own log is missing")
    elif not truth["trials"]:
        report.notes.append("recorded at a simulated bench; its log holds no committed trial")
    else:
        report.notes.append(
            f"recorded at a simulated bench; its log holds {truth['trials']} trials; largest "
            f"error {truth['max_speed_error_permille']} ‰ in speed, "
            f"{truth['max_force_error_permille']} ‰ in force"
        )
