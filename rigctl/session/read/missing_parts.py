"""Parts that a session had and that cannot be read, and the number of the next part."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format import file_names, layout
from rigctl.session.format.digests_file import listed_parts
from rigctl.session.format.file_names import part_name, part_number
from rigctl.session.format.writer_lock import is_being_written
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import existing_parts
from rigctl.session.read.recovery_file import QUARANTINE, RecoveryRecord, read_recoveries

_QUARANTINED = re.compile(r"(part-[0-9]{4,5})\..*h5")


@dataclass(frozen=True, slots=True)
class MissingPart:
    """A part whose rows are left out; ``reason`` continues a sentence that its name begins.

    ``is_known``: a recovery file says that it is gone.
    """

    name: str
    reason: str
    is_known: bool = False

    @property
    def sentence(self) -> str:
        """What is wrong with the part, and what that means."""
        return f"{self.name} {self.reason}; its trials are left out"


def open_parts(paths: Sequence[Path]) -> tuple[list[PartReader], dict[int, str]]:
    """Open the parts that can be read; return them and the reason for each other one by number.

    Of parts of several sessions, those of the most frequent plan are read.
    """
    parts: list[PartReader] = []
    damaged: dict[int, str] = {}
    for path in paths:
        try:
            parts.append(PartReader(path))
        except SessionError as error:
            damaged[part_number(path)] = _reason(path, error)
    for part, reason in _foreign(parts):
        part.close()
        parts.remove(part)
        damaged[part.number] = reason
    return parts, damaged


def find_missing(
    folder: Path,
    parts: Sequence[PartReader],
    damaged: Mapping[int, str],
    recoveries: Sequence[RecoveryRecord],
) -> tuple[MissingPart, ...]:
    """Return the parts that are missing beside the readable ``parts``, in their order.

    ``damaged``: reasons of those that exist and cannot be read.
    """
    present = {part.number for part in parts}
    reasons = dict.fromkeys(range(1, max(present | damaged.keys(), default=0)), "is missing")
    reasons |= dict.fromkeys(
        listed_parts(folder), f"is missing, {file_names.DIGEST_LINES_FILE} lists it"
    )
    if not is_being_written(folder):  # else its writer may be about to begin the next part
        reasons |= _announced(parts)
    known = {part.number: one for one in recoveries for part in one.removed_parts}
    reasons |= {n: f"is missing, {recovery.path.name} says why" for n, recovery in known.items()}
    reasons |= damaged
    return tuple(
        MissingPart(part_name(n), reasons[n], n in known and n not in damaged)
        for n in sorted(reasons.keys() - present)
    )


def highest_number(folder: Path) -> int:
    """Return the highest number that a part of this session has or had; 0 without any.

    No later part may take the number of one that is damaged, gone or in quarantine.
    """
    names = [path.name for path in folder.glob(file_names.PART_PATTERN)]
    quarantined = [_QUARANTINED.fullmatch(p.name) for p in folder.glob(f"{QUARANTINE}/*.h5")]
    names += [f"{found[1]}.h5" for found in quarantined if found]
    names += [part.name for each in read_recoveries(folder) for part in each.parts]
    numbers = [*map(part_number, map(Path, names)), *listed_parts(folder)]
    parts, _ = open_parts(existing_parts(folder)[-1:])
    numbers += _announced(parts)
    for part in parts:
        part.close()
    return max(numbers, default=0)


def _reason(path: Path, error: SessionError) -> str:
    """Return the error without the file's path, which the part's name replaces."""
    text = str(error)
    return text.removeprefix(f"{path} ") if text.startswith(f"{path} ") else f"is damaged: {text}"


def _foreign(parts: Sequence[PartReader]) -> list[tuple[PartReader, str]]:
    """Return the parts that were recorded under another number or for another plan."""
    found = []
    for part in parts:
        number = part.attributes.get("part")
        if number != part.number:
            found.append((part, f"claims to be part {number}: it is a copy or was renamed"))
    plans = Counter(_plan(part) for part in parts)
    if len(plans) > 1:
        (common, _), *_ = plans.most_common(1)
        moved = {id(part) for part, _ in found}
        found += [
            (part, "belongs to a session of another plan or sensor")
            for part in parts
            if _plan(part) != common and id(part) not in moved
        ]
    return found


def _plan(part: PartReader) -> tuple[str, str, int]:
    return part.layout.experiment, part.header.plan_hash, part.header.n_taxels


def _announced(parts: Sequence[PartReader]) -> dict[int, str]:
    """Return the part that the last one says to have been followed by, if it is newer than that."""
    if not parts or not parts[-1].finished or not parts[-1].has_digests:
        return {}
    last = parts[-1]
    if len(last.rows_where(layout.EVENTS, "kind", layout.SESSION_END_KIND)):
        return {}
    return {last.number + 1: f"is missing, {last.path.name} says that another part followed it"}
