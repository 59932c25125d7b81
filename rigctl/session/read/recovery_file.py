"""Recovery files: what ``rigctl recover`` put in order in a session, and what it could not save.

``recovery-YYYYMMDDThhmmssZ.json`` is one JSON object with a digest of its own, as
:mod:`rigctl.session.format.sealed_json` makes it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rigctl.errors import SessionError
from rigctl.session.format.file_names import part_number
from rigctl.session.format.sealed_json import read_sealed, sealed_text

KIND, VERSION = "rigctl-recovery", 1
PATTERN = "recovery-*.json"
PENDING_PATTERN = "recovery-*.json.new"
"""A recovery that is under way, or that was interrupted."""
QUARANTINE = "quarantine"
MAX_BYTES = 64 << 20
_REMEDY = "move it elsewhere and let rigctl recover make a new one"
_HEX = re.compile(r"(?:[0-9a-f]{64})?")
_PLACE = re.compile(rf"{QUARANTINE}/[A-Za-z0-9_-][A-Za-z0-9_.-]{{0,127}}")
_NOT_A_NAME = re.compile(r"[/\\\0]")
_TABLE = re.compile(r"/[a-z_]{1,32}(?:/[a-z_]{1,32})?")


@dataclass(frozen=True, slots=True)
class RecoveredPart:
    """A part that was taken out or replaced, or that was missing.

    ``sha256`` and ``n_bytes`` are the original's, "" and 0 if there was none; ``quarantined_as`` is
    its place now, relative to the session, "" if there was none. ``last_digest``: the original's
    last digest, "" if unknown. ``replaced_by``: SHA-256 of the new part, "" for none.
    """

    name: str
    reason: str
    sha256: str = ""
    n_bytes: int = 0
    quarantined_as: str = ""
    last_digest: str = ""
    replaced_by: str = ""

    @property
    def number(self) -> int:
        """Number of the part."""
        return part_number(Path(self.name))


@dataclass(frozen=True, slots=True)
class MovedFile:
    """A file that is no part, or not a whole one, in quarantine since."""

    name: str
    reason: str
    sha256: str
    n_bytes: int
    quarantined_as: str


@dataclass(frozen=True, slots=True)
class KnownDamage:
    """Rows of a readable part that are not those that were recorded.

    ``sha256``: of the rows' present bytes as stored, so that later damage is told apart.
    """

    part: int
    table: str
    first_row: int
    n_rows: int
    sha256: str


@dataclass(frozen=True, slots=True)
class LeftOutTrial:
    """An attempt that is left out: row ``row`` of /trials in part ``part``."""

    part: int
    row: int
    trial_id: int
    attempt: int
    reason: str


@dataclass(frozen=True, slots=True)
class RecoveryRecord:
    """One recovery file.

    ``parts``, ``damaged_rows`` and ``left_out`` are what readers need, ``moved`` are other files in
    quarantine. ``report`` holds all members of the file, also those for people.
    """

    path: Path
    made_utc: str
    parts: tuple[RecoveredPart, ...]
    damaged_rows: tuple[KnownDamage, ...]
    left_out: tuple[LeftOutTrial, ...]
    moved: tuple[MovedFile, ...]
    report: Mapping[str, Any]

    @property
    def removed_parts(self) -> tuple[RecoveredPart, ...]:
        """Parts that the session has no longer."""
        return tuple(part for part in self.parts if not part.replaced_by)

    @property
    def replaced_parts(self) -> tuple[RecoveredPart, ...]:
        """Parts that were written anew from what could be read."""
        return tuple(part for part in self.parts if part.replaced_by)


def read_recoveries(folder: Path) -> tuple[RecoveryRecord, ...]:
    """Return the intact recovery files of a session, oldest first."""
    found = []
    for path in sorted(folder.glob(PATTERN)):
        try:
            found.append(read_recovery(path))
        except SessionError:
            continue  # damaged_recoveries names it
    return tuple(found)


def damaged_recoveries(folder: Path) -> list[str]:
    """Return a sentence for each recovery file that cannot be read or was altered."""
    lines = []
    for path in sorted(folder.glob(PATTERN)):
        try:
            read_recovery(path)
        except SessionError as error:
            lines.append(str(error))
    lines += [
        f"{path} is of a recovery that was interrupted: run rigctl recover again"
        for path in sorted(folder.glob(PENDING_PATTERN))
    ]
    return lines


def read_recovery(path: Path) -> RecoveryRecord:
    """Return one file. Raises SessionError for a damaged, altered or other one."""
    members = read_sealed(path, MAX_BYTES, _REMEDY)
    if (members.get("kind"), members.get("version")) != (KIND, VERSION):
        raise SessionError(f"{path} is not a recovery file that this program reads")
    return RecoveryRecord(
        path,
        _text(path, members, "made_utc"),
        tuple(_recovered_part(path, each) for each in _list(path, members, "parts")),
        tuple(_known_damage(path, each) for each in _list(path, members, "damaged_rows")),
        tuple(_left_out(path, each) for each in _list(path, members, "left_out")),
        tuple(_moved_file(path, each) for each in _list(path, members, "moved")),
        members,
    )


def recovery_text(
    made_utc: str,
    parts: tuple[RecoveredPart, ...],
    damaged_rows: tuple[KnownDamage, ...],
    left_out: tuple[LeftOutTrial, ...],
    moved: tuple[MovedFile, ...],
    report: Mapping[str, Any],
) -> str:
    """Return the text of a recovery file; ``report``: further members, for people."""
    members = {
        "kind": KIND,
        "version": VERSION,
        "made_utc": made_utc,
        **report,
        "parts": [asdict(part) for part in parts],
        "damaged_rows": [asdict(rows) for rows in damaged_rows],
        "left_out": [asdict(trial) for trial in left_out],
        "moved": [asdict(file) for file in moved],
    }
    return sealed_text(members)


def _recovered_part(path: Path, members: Mapping[str, Any]) -> RecoveredPart:
    name = _text(path, members, "name")
    digests = [_text(path, members, key) for key in ("sha256", "last_digest", "replaced_by")]
    if not part_number(Path(name)) or not all(map(_HEX.fullmatch, digests)):
        raise SessionError(f"{path}: {name!r} under parts is not a part with its digests")
    place = _place(path, members)
    reason, n_bytes = _text(path, members, "reason"), _number(path, members, "n_bytes")
    return RecoveredPart(name, reason, digests[0], n_bytes, place, digests[1], digests[2])


def _moved_file(path: Path, members: Mapping[str, Any]) -> MovedFile:
    name, digest = _text(path, members, "name"), _text(path, members, "sha256")
    if _NOT_A_NAME.search(name) or name in ("", ".", "..") or not _HEX.fullmatch(digest):
        raise SessionError(f"{path}: {name!r} under moved is not a file with a digest")
    reason, n_bytes = _text(path, members, "reason"), _number(path, members, "n_bytes")
    return MovedFile(name, reason, digest, n_bytes, _place(path, members))


def _place(path: Path, members: Mapping[str, Any]) -> str:
    """Return where a file is in quarantine, relative to the session."""
    place = _text(path, members, "quarantined_as")
    if place and not _PLACE.fullmatch(place):
        raise SessionError(f"{path}: {place!r} is not a place in {QUARANTINE}")
    return place


def _known_damage(path: Path, members: Mapping[str, Any]) -> KnownDamage:
    table, digest = _text(path, members, "table"), _text(path, members, "sha256")
    if not (table == "/" or _TABLE.fullmatch(table)) or not _HEX.fullmatch(digest):
        raise SessionError(f"{path}: {table!r} under damaged_rows is not a table with a digest")
    part, first_row, n_rows = (
        _number(path, members, key) for key in ("part", "first_row", "n_rows")
    )
    return KnownDamage(part, table, first_row, n_rows, digest)


def _left_out(path: Path, members: Mapping[str, Any]) -> LeftOutTrial:
    part, row, trial_id, attempt = (
        _number(path, members, key) for key in ("part", "row", "trial_id", "attempt")
    )
    return LeftOutTrial(part, row, trial_id, attempt, _text(path, members, "reason"))


def _text(path: Path, members: Mapping[str, Any], key: str) -> str:
    return str(_member(path, members, key, str))


def _number(path: Path, members: Mapping[str, Any], key: str) -> int:
    value = _member(path, members, key, int)
    if isinstance(value, bool) or not -(2**63) <= value < 2**63:
        raise SessionError(f"{path}: {key} is not a number that fits")
    return int(value)


def _list(path: Path, members: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    values = _member(path, members, key, list)
    if not all(isinstance(each, dict) for each in values):
        raise SessionError(f"{path}: {key} is not a list of objects")
    return list(values)


def _member(path: Path, members: Mapping[str, Any], key: str, kind: type) -> Any:
    value = members.get(key)
    if not isinstance(value, kind):
        raise SessionError(f"{path}: {key} is missing or not of type {kind.__name__}")
    return value
