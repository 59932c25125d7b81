"""Put a session in order: ``rigctl recover``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rigctl import __version__
from rigctl.errors import DiskFault, SessionError
from rigctl.session.format.digests_file import listed_parts
from rigctl.session.format.file_names import DIGEST_LINES_FILE, LOCK_FILE, part_number
from rigctl.session.format.writer_lock import WriterLock, is_being_written, lock_owner_pid
from rigctl.session.open_session import open_session
from rigctl.session.read.closing_digest import last_digest
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import existing_parts, no_session, open_cut_part
from rigctl.session.read.recovery_file import (
    PENDING_PATTERN,
    QUARANTINE,
    MovedFile,
    RecoveredPart,
    RecoveryRecord,
    recovery_text,
)
from rigctl.session.recover.journal import REPLACEMENT, carry_out, finish_pending, write_journal
from rigctl.session.recover.prefix import SavedRows, savable_rows
from rigctl.session.recover.rebuilt_lines import rebuild_lines
from rigctl.session.recover.replacement import Attempt, check_room, close_copy, write_prefix
from rigctl.session.recover.saved_parts import SavedPart, find_saved, put_back
from rigctl.session.recover.survey import (
    PartFinding,
    Remedy,
    StrayFile,
    Survey,
    part_sha256,
    survey,
)
from rigctl.values import Verdict

PUT_BACK = "put back"
NAME_DIGITS = 16
"""Digits of the SHA-256 in a file's name in quarantine."""


@dataclass(frozen=True, slots=True)
class PartOutcome:
    """What became, or would become, of a part.

    ``rows``: of each data set; ``attempts``: the committed ones that are saved; ``reason``
    continues a sentence that the name begins.
    """

    name: str
    remedy: str
    reason: str
    rows: Mapping[str, SavedRows] = field(default_factory=dict)
    attempts: tuple[Attempt, ...] = ()
    trials_planned: int = 0


@dataclass(frozen=True, slots=True)
class RecoveryResult:
    """What a recovery did, or would do.

    ``record``: the recovery file, None if nothing was to do or nothing was done. ``strays``: other
    files for the quarantine. ``not_committed``: planned trials that no readable part holds.
    """

    parts: tuple[PartOutcome, ...]
    strays: tuple[StrayFile, ...]
    findings: Survey
    not_committed: tuple[int, ...]
    record: RecoveryRecord | None = None
    finished: tuple[RecoveryRecord, ...] = ()


def recover(folder: Path, now_utc: str, *, dry_run: bool = False) -> RecoveryResult:
    """Put a session in order, and say what was saved and what was not.

    ``now_utc``: ISO 8601 with seconds, such as ``2026-11-23T14:00:00Z``. With ``dry_run``, only say
    what would be done. Raises SessionError while a process writes the session and for another kind
    of folder, DiskFault if there is no room or the disk refuses; nothing is lost then, and the next
    recovery finishes it.
    """
    _check_folder(folder)
    if dry_run:
        return _with_saved(_plan(folder), find_saved(folder))
    had_lock = (folder / LOCK_FILE).exists()
    lock = WriterLock(folder)
    try:
        finished = tuple(finish_pending(folder))
        saved = find_saved(folder)
        replaced = tuple(filter(None, [put_back(each, _place) for each in saved]))
    finally:
        lock.release()
    planned = _plan(folder)
    if planned.findings.is_in_order and not replaced:
        return RecoveryResult((), (), planned.findings, planned.not_committed, None, finished)
    lock = WriterLock(folder)
    try:
        record = _put_in_order(folder, now_utc, planned, had_lock, replaced)
        if planned.findings.lines_problem:
            _rebuild_lines(folder)
    finally:
        lock.release()
    return RecoveryResult(
        planned.parts, planned.strays, planned.findings, planned.not_committed, record, finished
    )


def _with_saved(planned: RecoveryResult, saved: Sequence[SavedPart]) -> RecoveryResult:
    """Return a plan in which saved parts take the places of what is found there now."""
    names = {each.path.name for each in saved}
    outcomes = [PartOutcome(each.path.name, PUT_BACK, each.reason) for each in saved]
    outcomes += [outcome for outcome in planned.parts if outcome.name not in names]
    return replace(planned, parts=tuple(outcomes))


def _check_folder(folder: Path) -> None:
    known = existing_parts(folder) or listed_parts(folder) or list(folder.glob(PENDING_PATTERN))
    if not known:
        raise no_session(folder)
    if is_being_written(folder):
        raise SessionError(
            f"{folder} is being written by process {lock_owner_pid(folder)}: stop that run first"
        )


def _plan(folder: Path) -> RecoveryResult:
    """Return what would be done; read every damaged part, write nothing."""
    found = survey(folder)
    outcomes = tuple(map(_outcome, found.parts))
    outcomes += tuple(PartOutcome(part.name, "missing", part.reason) for part in found.absent)
    return RecoveryResult(outcomes, found.strays, found, _not_committed(folder, outcomes))


def _outcome(finding: PartFinding) -> PartOutcome:
    name, remedy, reason = finding.path.name, finding.remedy.value, finding.reason
    if finding.remedy is Remedy.REMOVE:
        return PartOutcome(name, remedy, reason)
    part = PartReader(finding.path, open_cut_part)
    try:
        rows = savable_rows(part)
        table = part.layout.trials
        trials = part.rows(table, 0, rows[table.path].saved)
        trials = trials[trials["verdict"] == Verdict.COMMITTED.value]
        planned = part.header.trials_planned
    finally:
        part.close()
    attempts = zip(trials["trial_id"].tolist(), trials["attempt"].tolist(), strict=True)
    return PartOutcome(name, remedy, reason, rows, tuple(attempts), planned)


def _not_committed(folder: Path, outcomes: Sequence[PartOutcome]) -> tuple[int, ...]:
    """Return the planned trials that neither a readable part nor a saved one holds."""
    planned = max((outcome.trials_planned for outcome in outcomes), default=0)
    found = {trial for outcome in outcomes for trial, _ in outcome.attempts}
    with suppress(SessionError), open_session(folder) as session:  # no part may be readable
        planned = session.header.trials_planned
        found |= set(session.trials["trial_id"][session.committed()].tolist())
    return tuple(sorted(set(range(1, planned + 1)) - found))


def _put_in_order(
    folder: Path,
    now_utc: str,
    planned: RecoveryResult,
    had_lock: bool,
    replaced: tuple[MovedFile, ...],
) -> RecoveryRecord:
    """Write the replacements and the journal, then carry it out.

    ``replaced``: files in whose places saved parts are, in quarantine already.
    """
    found = planned.findings
    rebuilt = [each for each in found.parts if each.remedy is not Remedy.REMOVE]
    check_room(folder, sum(each.path.stat().st_size for each in rebuilt))
    digests = {number: part.digest for number, part in listed_parts(folder).items()}
    parts = [_build(each, digests.get(part_number(each.path), "")) for each in found.parts]
    for absent in found.absent:
        digest = digests.get(part_number(Path(absent.name)), "")
        parts.append(RecoveredPart(absent.name, absent.reason, last_digest=digest))
    report = {
        "software": __version__,
        "stale_lock": had_lock,
        "saved": [_describe(outcome) for outcome in planned.parts],
        "not_committed": list(planned.not_committed),
        "digest_lines": found.lines_problem,
    }
    moved = (*replaced, *map(_moved, found.strays))
    text = recovery_text(now_utc, tuple(parts), found.damaged_rows, found.left_out, moved, report)
    return carry_out(write_journal(_free_path(folder, now_utc), text))


def _rebuild_lines(folder: Path) -> None:
    try:
        rebuild_lines(folder)
    except OSError as error:
        raise DiskFault(
            f"cannot write {folder / DIGEST_LINES_FILE}: {error.strerror}; make room, then run "
            "rigctl recover again"
        ) from error


def _build(finding: PartFinding, listed_digest: str) -> RecoveredPart:
    """Write the replacement of a part, if it gets one; return what the recovery file says."""
    path, sha256 = finding.path, part_sha256(finding.path)
    place, new = _place(path, sha256), path.with_name(path.name + REPLACEMENT)
    digest = listed_digest
    if finding.remedy is not Remedy.REMOVE:
        digest = _last_digest(path) or listed_digest
    if finding.remedy is Remedy.CLOSE:
        close_copy(path, new)
    elif finding.remedy is Remedy.REWRITE:
        write_prefix(path, new, place)
    replaced_by = "" if finding.remedy is Remedy.REMOVE else part_sha256(new)
    size = path.stat().st_size
    return RecoveredPart(path.name, finding.reason, sha256, size, place, digest, replaced_by)


def _last_digest(path: Path) -> str:
    """Return the last digest that can be read; empty if its table was cut short."""
    part = PartReader(path, open_cut_part)
    try:
        return "" if "/digests" in part.cut_rows else last_digest(part)
    finally:
        part.close()


def _moved(stray: StrayFile) -> MovedFile:
    sha256 = part_sha256(stray.path)
    size = stray.path.stat().st_size
    return MovedFile(stray.path.name, stray.reason, sha256, size, _place(stray.path, sha256))


def _place(path: Path, sha256: str) -> str:
    """Return the place of a file in quarantine: the same for the same bytes."""
    letters = (c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in path.stem[:64])
    suffix = path.suffix if path.suffix[1:].isalnum() and path.suffix.isascii() else ""
    return f"{QUARANTINE}/{''.join(letters)}.{sha256[:NAME_DIGITS]}{suffix}"


def _describe(outcome: PartOutcome) -> dict[str, Any]:
    return {
        "name": outcome.name,
        "remedy": outcome.remedy,
        "reason": outcome.reason,
        "rows": {
            path: {"stored": rows.stored, "saved": rows.saved, "proved": rows.proved}
            for path, rows in outcome.rows.items()
        },
        "attempts": [list(attempt) for attempt in outcome.attempts],
    }


def _free_path(folder: Path, now_utc: str) -> Path:
    """Return the path of a new recovery file: of this second, or the next that has none."""
    stamp = now_utc[:19].replace("-", "").replace(":", "")
    paths = (folder / f"recovery-{stamp}{extra}Z.json" for extra in ("", *range(2, 1000)))
    return next(path for path in paths if not path.exists())
