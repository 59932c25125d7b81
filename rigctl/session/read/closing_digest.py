"""Read how a session ended: its closing digest, and the event that says why it was closed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from rigctl.errors import SessionError
from rigctl.session.format import file_names, layout
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.layout import SessionOutcome
from rigctl.session.format.table_rows import parse_event
from rigctl.session.read.part import PartReader
from rigctl.session.read.part_file import part_paths
from rigctl.values import Verdict


def read_closing_digest(folder: Path) -> str:
    """Return the last digest of a session; empty if its last part is not closed or not readable.

    Raises SessionError for another kind of folder.
    """
    path = max(part_paths(folder), key=file_names.part_number)
    try:
        part = PartReader(path)
    except SessionError:
        return ""
    try:
        return last_digest(part) if part.finished else ""
    finally:
        part.close()


def last_digest(part: PartReader) -> str:
    """Return the last digest of a part, empty for a part from before there were digests."""
    n_rows = part.n_rows(DIGESTS) if part.has_digests else 0
    return str(part.rows(DIGESTS, n_rows - 1)["digest"][0]) if n_rows else ""


def count_committed(parts: Iterable[PartReader]) -> dict[str, int]:
    """Return how many different trials were committed by the end of each part, by its name.

    ``parts`` are in their order; trials of a part that is left out are not counted.
    """
    committed: set[int] = set()
    counts: dict[str, int] = {}
    for part in parts:
        rows = part.rows(part.layout.trials)
        committed |= set(rows["trial_id"][rows["verdict"] == Verdict.COMMITTED.value].tolist())
        counts[part.path.name] = len(committed)
    return counts


def session_end(part: PartReader) -> Mapping[str, object] | None:
    """Return how the sitting ended, if the part is the last one of it.

    Raises SessionError for an event that no recording wrote.
    """
    rows = part.rows_where(layout.EVENTS, "kind", layout.SESSION_END_KIND)
    if not len(rows):
        return None
    data = parse_event(rows[-1], part.path).data
    if data.get("outcome") not in list(SessionOutcome):
        raise SessionError(f"{part.path}: its event session_end has no outcome")
    return data
