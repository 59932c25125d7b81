"""Find the rows of a damaged part that can be saved: the longest prefix of each data set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.digests import next_digest
from rigctl.session.read.part import PartReader

READ_ROWS = 1 << 16


@dataclass(frozen=True, slots=True)
class SavedRows:
    """Rows of one data set: those stored, those saved, and those that a digest proves.

    Saved rows without a proof were readable, and no digest that is left covers them.
    """

    stored: int
    saved: int
    proved: int


def savable_rows(part: PartReader) -> dict[str, SavedRows]:
    """Return the rows of each data set that can be read and that no digest contradicts.

    The arrays of samples have one length, and an attempt at a trial is saved with its samples or
    not at all.
    """
    stored = {path: n for path, n in part.stored_lengths().items() if path != DIGESTS.path}
    stored = {path: n + part.cut_rows.get(path, 0) for path, n in stored.items()}
    readable = {path: _readable(part, path) for path in stored}
    limits, proved = _check_digests(part, readable)
    n_samples = min(limits[array.path] for array in part.layout.arrays)
    limits |= {array.path: n_samples for array in part.layout.arrays}
    limits[layout.ARRIVALS.path] = _rows_before(part, limits, n_samples)
    limits[part.layout.trials.path] = _whole_trials(part, limits, n_samples)
    return {
        path: SavedRows(n, limits[path], min(limits[path], proved.get(path, 0)))
        for path, n in stored.items()
    }


def _readable(part: PartReader, path: str) -> int:
    """Return how many rows can really be read, from the first on."""
    n_rows = part.stored_lengths()[path]
    for start in range(0, n_rows, READ_ROWS):
        try:
            part.stored_rows(path, start, min(n_rows, start + READ_ROWS))
        except SessionError:
            return start
    return n_rows


def _check_digests(
    part: PartReader, readable: dict[str, int]
) -> tuple[dict[str, int], dict[str, int]]:
    """Return the rows before the first contradiction in each data set, and the proved ones."""
    limits, proved = dict(readable), dict.fromkeys(readable, 0)
    previous = ""
    for row in part.rows(DIGESTS):
        path, first, n_rows = str(row["table"]), int(row["first_row"]), int(row["n_rows"])
        before, previous = previous, str(row["digest"])
        if path not in limits or not before or first != proved[path]:
            continue
        if not 0 < n_rows <= limits[path] - first:
            continue
        rows = np.ascontiguousarray(part.stored_rows(path, first, first + n_rows))
        if next_digest(before, path, first, n_rows, rows.tobytes()) == previous:
            proved[path] = first + n_rows
        else:
            limits[path] = first
    return limits, proved


def _rows_before(part: PartReader, limits: dict[str, int], n_samples: int) -> int:
    """Return the arrivals of the samples that are saved."""
    arrivals = part.rows(layout.ARRIVALS, 0, limits[layout.ARRIVALS.path])
    beyond = np.flatnonzero(arrivals["first_row"] >= n_samples)
    return int(beyond[0]) if len(beyond) else len(arrivals)


def _whole_trials(part: PartReader, limits: dict[str, int], n_samples: int) -> int:
    """Return the attempts from the first on whose samples are saved."""
    table = part.layout.trials
    rows = part.rows(table, 0, limits[table.path])
    if all(n_samples == n and path not in part.cut_rows for path, n in part.lengths().items()):
        return len(rows)
    beyond = (rows["first_sample"] + rows["count"] > n_samples) & (rows["first_sample"] >= 0)
    return int(np.flatnonzero(beyond)[0]) if beyond.any() else len(rows)
