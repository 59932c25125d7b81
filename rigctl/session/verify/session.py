"""Verify a session: every sample, gap and trial agrees with the tables.

A *problem* fails the check. A *note* is harmless: a part whose writer was killed before another
continued the session, or trials that are not recorded yet.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.early_end import describe_ends, ended_early
from rigctl.session.files.truth_file import log_paths
from rigctl.session.format.metadata.sensor_layout import layouts_match
from rigctl.session.format.metadata.wiring import session_wiring
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.notes.note_files import damaged_notes
from rigctl.session.read.finger_session import FingerSession, is_finger_session
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.read.part_file import part_paths, stray_files
from rigctl.session.read.recovery_file import damaged_recoveries, read_recoveries
from rigctl.session.read.session import Session
from rigctl.session.read.session_reader import SessionReader
from rigctl.session.verify.drum import check_drum_plan, check_truth
from rigctl.session.verify.ending import compare_digest
from rigctl.session.verify.part import check_part
from rigctl.session.verify.record import RecordCheck
from rigctl.session.verify.report import OnProgress, VerifyReport
from rigctl.session.verify.values.part_values import check_values

TRUTH_SHARE = 0.25
"""Measured share of the work if there is such a log."""
DIGESTS_SHARE = 0.5
"""Measured share of a part's work that its digests take."""
SAME_IN_ALL_PARTS = (
    "plan_hash",
    "seed",
    "trials_planned",
    "n_taxels",
    "sample_rate_hz",
    "reference_um_per_s",
)

CheckPart = Callable[[PartReader, StructuredArray], tuple[list[str], list[str]]]
"""Returns problems and notes of a part and of its rows of /trials."""


def verify(
    path: Path, on_progress: OnProgress = lambda share, what: None, digest: str = ""
) -> VerifyReport:
    """Check everything in a session. Raises SessionError for another kind of folder.

    ``digest``: its closing digest as it was kept elsewhere, "" for none.

    Calls ``on_progress`` with the share of the work done, 0 to 1, and the next step. Holds one
    block of samples at a time, however long the session is.
    """
    report = VerifyReport()
    part_paths(path)  # raises SessionError for another kind of folder
    try:
        if is_finger_session(path):
            _verify_finger(path, report, on_progress, digest)
        else:
            _verify_drum(path, report, on_progress, digest)
    except SessionError as error:
        report.problems.append(str(error))
    return report


def _verify_drum(path: Path, report: VerifyReport, on_progress: OnProgress, digest: str) -> None:
    parts_share = 1.0 - TRUTH_SHARE if log_paths(path) else 1.0
    with Session.open(path) as session:
        _check_parts(session, report)
        _check_wiring(session, report)
        _check_contents(session, check_part, report, on_progress, parts_share)
        check_drum_plan(session, report)
        check_truth(session, report, on_progress, parts_share)
        _check_kept_digest(session, digest, report)


def _verify_finger(path: Path, report: VerifyReport, on_progress: OnProgress, digest: str) -> None:
    # Imported late: the encoder takes a second to load.
    from rigctl.session.verify.finger import check_finger_part, check_finger_plan

    with FingerSession.open(path) as session:
        _check_parts(session, report)
        _check_contents(session, check_finger_part, report, on_progress, 1.0)
        check_finger_plan(session, report)
        _check_kept_digest(session, digest, report)


def _check_contents(
    session: SessionReader,
    check: CheckPart,
    report: VerifyReport,
    on_progress: OnProgress,
    share: float,
) -> None:
    n_parts = len(session.parts)
    record = RecordCheck(session, report)
    for done, part in enumerate(session.parts):
        step = partial(_show, on_progress, share / n_parts, done, f"part {done + 1} of {n_parts}")
        step(0.0)
        known = False
        try:
            known = record.check_part(done, step)
            problems, notes = check(part, session.trials[session.trials["part"] == part.number])
            value_problems, value_notes = check_values(part)
        except SessionError as error:
            (report.notes if known else report.problems).append(str(error))
            continue
        # What does not fit where a recovery file lists altered rows comes from these rows.
        found = report.notes if known else report.problems
        found += [f"{part.path.name}: {line}" for line in (*problems, *value_problems)]
        report.notes += [f"{part.path.name}: {line}" for line in (*notes, *value_notes)]
    on_progress(share, "the plan")
    record.check_whole()
    report.samples = session.n_samples
    report.lost_samples = int(session.gaps["count"].sum())
    _check_committed(session, report)


def _show(
    on_progress: OnProgress, part_share: float, part: int, what: str, digests_done: float
) -> None:
    on_progress(part_share * (part + DIGESTS_SHARE * digests_done), what)


def _check_kept_digest(session: SessionReader, digest: str, report: VerifyReport) -> None:
    if digest:
        compare_digest(session.parts, digest, read_recoveries(session.path), report)


def _check_committed(session: SessionReader, report: VerifyReport) -> None:
    """Check that each committed trial occurs once."""
    counts = Counter(session.trials["trial_id"][session.committed()].tolist())
    report.trials_committed = len(counts)
    report.problems += [
        f"trial {number} is committed {count} times"
        for number, count in counts.items()
        if count > 1
    ]
    ended = ended_early(session) if isinstance(session, Session) else {}
    report.notes += describe_ends(ended)
    missing = session.header.trials_planned - len(counts) - len(ended)
    if missing > 0:
        report.notes.append(
            f"{missing} of {session.header.trials_planned} planned trials are not committed"
        )


def _check_parts(session: SessionReader, report: VerifyReport) -> None:
    recoveries = read_recoveries(session.path)
    replaced = {part.number for each in recoveries for part in each.replaced_parts}
    for missing in session.missing_parts:
        (report.notes if missing.is_known else report.problems).append(missing.sentence)
    report.problems += [*damaged_recoveries(session.path), *damaged_notes(session.path)]
    report.notes += [f"noted {note.made_utc}: {note.describe()}" for note in session.notes]
    report.notes += [
        f"{name}: is not a part of the session, its name is not that of one"
        for name in stray_files(session.path)
    ]
    for part in session.parts:
        _check_header(session, part, report)
        report.problems += part.describe_cut()
        if part.finished:
            continue
        if part is not session.parts[-1]:
            report.notes.append(
                f"{part.path.name}: was not closed properly, a later part continues the session"
            )
        elif part.number in replaced:
            report.notes.append(f"{part.path.name}: was not closed, and was put in order since")
        elif is_being_written(session.path):
            report.problems.append(f"{part.path.name}: is still being written")
        else:
            report.problems.append(
                f"{part.path.name}: was not closed properly, its writer was killed or could "
                "not write; committed trials are safe, continue with --resume of the command that "
                "made it, or put it in order with rigctl recover"
            )


def _check_header(session: SessionReader, part: PartReader, report: VerifyReport) -> None:
    number = part.attributes.get("part")
    if number != part.number:
        report.problems.append(f"{part.path.name}: claims to be part {number}")
    for name in SAME_IN_ALL_PARTS:
        if getattr(part.header, name) != getattr(session.header, name):
            report.problems.append(f"{part.path.name}: has another {name} than the first part")
    _check_layout(session, part, report)


def _check_layout(session: SessionReader, part: PartReader, report: VerifyReport) -> None:
    if not layouts_match(part.header.sensor_layout, session.header.sensor_layout):
        report.problems.append(f"{part.path.name}: has another sensor_layout than the first part")


def _check_wiring(session: Session, report: VerifyReport) -> None:
    report.problems += [
        f"{part.path.name}: has its taxels in another order than the first"
        for part in session.parts
        if session_wiring(part.header, part.text("/rig_toml")) != session.wiring
    ]
