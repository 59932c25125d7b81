"""Look through a session's folder for what is not in order."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from enum import StrEnum
from pathlib import Path

from rigctl.config.text_file import open_file, refuse_link_outside
from rigctl.errors import SessionError
from rigctl.session.chain.digest_table import RowRange
from rigctl.session.chain.touched_trials import touched_attempts
from rigctl.session.files.ground_truth import check_log
from rigctl.session.files.truth_file import log_paths
from rigctl.session.format.digests import DESCRIPTION
from rigctl.session.format.file_names import DIGEST_LINES_FILE, part_number
from rigctl.session.open_session import open_session
from rigctl.session.read.damage import describe_rows, find_damaged_rows
from rigctl.session.read.missing_parts import MissingPart, open_parts
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import existing_parts, open_cut_part, stray_files
from rigctl.session.read.recovery_file import (
    KnownDamage,
    LeftOutTrial,
    RecoveryRecord,
    read_recoveries,
)
from rigctl.session.recover.rebuilt_lines import lines_problem
from rigctl.session.verify.digest_lines import changed_texts

UNFINISHED_PART = "part-*.new"


class Remedy(StrEnum):
    """What becomes of a part; the original goes to quarantine in each case."""

    CLOSE = "closed copy"
    REWRITE = "rewritten"
    REMOVE = "removed"


@dataclass(frozen=True, slots=True)
class PartFinding:
    """A part that is not in order; ``reason`` continues a sentence that its name begins."""

    path: Path
    remedy: Remedy
    reason: str


@dataclass(frozen=True, slots=True)
class StrayFile:
    """Another file that does not belong beside the parts, or is damaged."""

    path: Path
    reason: str


@dataclass(frozen=True, slots=True)
class Survey:
    """What is not in order in a session.

    ``parts``: files to close, rewrite or remove. ``absent``: parts without a file, of which no
    recovery file knows. ``damaged_rows`` and ``left_out``: altered rows of parts that stay, and
    the attempts that they touch. ``lines_problem``: what is wrong with ``digests.txt``.
    """

    parts: tuple[PartFinding, ...]
    absent: tuple[MissingPart, ...]
    strays: tuple[StrayFile, ...]
    lines_problem: str = ""
    damaged_rows: tuple[KnownDamage, ...] = ()
    left_out: tuple[LeftOutTrial, ...] = ()

    @property
    def is_in_order(self) -> bool:
        """Whether there is nothing to do."""
        listed = (self.parts, self.absent, self.strays, self.lines_problem, self.damaged_rows)
        return not any(listed)


def survey(folder: Path) -> Survey:
    """Look at every part, log and stray file of a session that nobody writes."""
    findings = tuple(_survey_parts(existing_parts(folder)))
    recoveries = read_recoveries(folder)
    return Survey(
        findings,
        _absent(folder),
        (*_strays(folder), *_texts(folder)),
        lines_problem(folder),
        *_damage(findings, folder, recoveries),
    )


def part_sha256(path: Path) -> str:
    """Return the SHA-256 of a file. Raises SessionError if it cannot be read, or is outside."""
    refuse_link_outside(path, SessionError)
    try:
        with open_file(path, SessionError) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise SessionError(f"{path} cannot be read: {error.strerror or error}") from error


def _survey_parts(paths: Sequence[Path]) -> Iterator[PartFinding]:
    parts, unreadable = open_parts(paths)
    by_path = {part.path: part for part in parts}
    for path in paths:
        part = by_path.get(path)
        if part is None:
            yield _judge_unreadable(path, unreadable)
        elif part.cut_rows:
            yield PartFinding(path, Remedy.REWRITE, "was cut short, and its writer was killed")
        elif part.file.is_cut:
            yield PartFinding(path, Remedy.CLOSE, "was not closed, its writer was killed")
    for part in parts:
        part.close()


def _judge_unreadable(path: Path, reasons: dict[int, str]) -> PartFinding:
    """Return whether something of a part that does not open can be read."""
    reason = reasons[part_number(path)]
    try:
        part = PartReader(path, open_cut_part)
    except SessionError:
        return PartFinding(path, Remedy.REMOVE, reason)
    is_own = part.attributes.get("part") == part.number
    part.close()
    return PartFinding(path, Remedy.REWRITE if is_own else Remedy.REMOVE, reason)


def _absent(folder: Path) -> tuple[MissingPart, ...]:
    """Return the parts without a file; none where no part is left to tell."""
    try:
        session = open_session(folder)
    except SessionError:
        return ()
    with session:
        missing = session.missing_parts
    return tuple(p for p in missing if not p.is_known and not (folder / p.name).exists())


def _strays(folder: Path) -> Iterator[StrayFile]:
    for name in stray_files(folder):
        yield StrayFile(folder / name, "is not a part, its name is not that of one")
    for path in sorted(folder.glob(UNFINISHED_PART)):
        yield StrayFile(path, "was left by a writer that was killed while it began a part")
    for path in log_paths(folder):
        try:
            check_log(path)
        except SessionError as error:
            yield StrayFile(path, str(error).removeprefix(f"{path} "))


def _texts(folder: Path) -> Iterator[StrayFile]:
    """Yield the texts beside the parts that were changed; the parts hold the originals."""
    parts, _ = open_parts(existing_parts(folder)[:1])
    for part in parts:
        for name in changed_texts(folder, part):
            yield StrayFile(folder / name, f"was changed, {part.path.name} contains the original")
        part.close()
    lines = folder / DIGEST_LINES_FILE
    if lines.exists() and (problem := lines_problem(folder)):
        yield StrayFile(lines, problem)


def _damage(
    findings: Sequence[PartFinding], folder: Path, recoveries: Sequence[RecoveryRecord]
) -> tuple[tuple[KnownDamage, ...], tuple[LeftOutTrial, ...]]:
    """Return altered rows of the parts that stay, and the attempts that they touch."""
    touched = {finding.path for finding in findings}
    parts, _ = open_parts([path for path in existing_parts(folder) if path not in touched])
    known = {rows for recovery in recoveries for rows in recovery.damaged_rows}
    damaged: list[KnownDamage] = []
    left_out: list[LeftOutTrial] = []
    for part in parts:
        for rows in find_damaged_rows(part):
            sha256 = damaged_bytes(part, rows.table, rows.first_row, rows.n_rows)
            damage = KnownDamage(part.number, rows.table, rows.first_row, rows.n_rows, sha256)
            if damage not in known:
                damaged.append(damage)
                left_out += _touched_trials(part, RowRange(*astuple(rows)[1:]))
        part.close()
    return tuple(damaged), tuple({(each.part, each.row): each for each in left_out}.values())


def _touched_trials(part: PartReader, place: RowRange) -> list[LeftOutTrial]:
    trials = part.rows(part.layout.trials)
    return [
        LeftOutTrial(
            part.number,
            row,
            int(trials["trial_id"][row]),
            int(trials["attempt"][row]),
            describe_rows(place),
        )
        for row in touched_attempts(part, place).tolist()
    ]


def damaged_bytes(part: PartReader, table: str, first_row: int, n_rows: int) -> str:
    """Return the SHA-256 of rows as they are stored now."""
    if table == DESCRIPTION:
        return hashlib.sha256(part.describe()).hexdigest()
    rows = part.stored_rows(table, first_row, first_row + n_rows)
    return hashlib.sha256(rows.tobytes()).hexdigest()
