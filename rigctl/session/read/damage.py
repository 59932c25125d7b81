"""Find the trials whose recorded rows were altered, so that an analysis can leave them out."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from rigctl.session.chain.digest_table import RowRange
from rigctl.session.chain.links import check_links
from rigctl.session.chain.touched_trials import touched_attempts
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.digests import DESCRIPTION
from rigctl.session.format.finger_layout import BATCHES, FINGER_LAYOUT, SPIKES
from rigctl.session.format.layout import COUNTER, SAMPLES
from rigctl.session.read.part import PartReader
from rigctl.session.read.session_reader import SessionReader
from rigctl.values import Verdict

OnProgress = Callable[[int, int], None]
"""Takes the bytes that are checked, and all bytes."""


@dataclass(frozen=True, slots=True)
class DamagedRows:
    """Rows of a table that are not those recorded; table ``/`` is the part's description."""

    part: int
    table: str
    first_row: int
    n_rows: int


def find_damaged_rows(
    part: PartReader,
    tables: Collection[str] | None = None,
    on_bytes: Callable[[int], None] = lambda n: None,
) -> list[DamagedRows]:
    """Return the rows of ``tables``, all of them if None, that do not agree with their digests.

    Rows that no digest covers are among them if the part was closed, and with all tables the rows
    of /digests that were altered themselves. A part from before there
    were digests has none; nor has one that grows, whose writer a reader must not delay. Raises
    SessionError for a part that cannot be read.
    """
    if not part.has_digests or part.is_growing:
        return []
    links = check_links(part, tables, on_bytes=on_bytes)
    found = [*links.damaged, *links.coverage.gone]
    if part.finished:
        found += links.coverage.uncovered
    if tables is None:
        altered = {*links.altered, *links.coverage.misplaced}
        found += [RowRange(DIGESTS.path, row, 1) for row in altered]
    return [
        DamagedRows(part.number, *place)
        for place in sorted(found)
        if tables is None or place.table == DESCRIPTION or place.table in tables
    ]


def damaged_trials(
    session: SessionReader, on_progress: OnProgress = lambda done, total: None
) -> dict[int, str]:
    """Return the attempts whose rows were altered, by their index in ``session.trials``.

    The value says which rows. Reads what an analysis needs: samples and trials, and with the
    moving finger spikes and batches. Raises SessionError for a part that cannot be read.
    """
    tables = {SAMPLES, COUNTER, session.layout.trials.path}
    if session.layout is FINGER_LAYOUT:
        tables |= {SPIKES, BATCHES.path}
    total = sum(part.path.stat().st_size for part in session.parts)
    done, first_index = 0, 0
    reasons: dict[int, str] = {}

    def add(n: int) -> None:
        nonlocal done
        done += n
        on_progress(min(done, total), total)

    for part in session.parts:
        verdicts = part.rows(session.layout.trials)["verdict"]
        listed = np.isin(verdicts, list(Verdict))  # other rows are not among the session's
        index = first_index - 1 + np.cumsum(listed)
        for rows in find_damaged_rows(part, tables, add):
            place = RowRange(rows.table, rows.first_row, rows.n_rows)
            touched = touched_attempts(part, place)
            for trial in index[touched[listed[touched]]].tolist():
                reasons.setdefault(trial, describe_rows(place))
        first_index += int(listed.sum())
    on_progress(total, total)
    return reasons


def describe_rows(place: RowRange) -> str:
    """Return a sentence on altered rows."""
    table, first, n_rows = place
    if table == DESCRIPTION:
        return "the part's attributes or texts are not those that were recorded"
    if n_rows == 1:
        return f"row {first} of {table} is not the one that was recorded"
    return f"rows {first}–{first + n_rows - 1} of {table} are not those that were recorded"
