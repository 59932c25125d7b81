"""Find the attempts that rows of a table belong to, where the rows themselves cannot be trusted.

The rows directly before and after them say when, or at which samples or scans, they were written.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.session.chain.digest_table import RowRange
from rigctl.session.format import finger_layout, layout
from rigctl.session.format.digests import DESCRIPTION
from rigctl.session.read.part import PartReader, StructuredArray

Mask = NDArray[np.bool_]
_MAX_NAMED = 3
_BY_SCAN = (finger_layout.BATCHES, finger_layout.WINDOWS, finger_layout.PREDICTIONS)


def touched_attempts(part: PartReader, place: RowRange) -> NDArray[np.int64]:
    """Return the rows of the part's /trials whose attempts need the rows of ``place``, int64.

    A part's description concerns all of its attempts.
    """
    trials = part.rows(part.layout.trials)
    end = place.first_row + place.n_rows
    if place.table == DESCRIPTION:
        return np.arange(len(trials))
    if place.table == part.layout.trials.path:
        return np.arange(place.first_row, min(end, len(trials)))
    if place.table in part.lengths():
        return np.flatnonzero(_with_samples(trials, place.first_row, end - 1))
    select = _selections(part).get(place.table)
    return np.flatnonzero(select(trials, place)) if select else np.empty(0, np.int64)


def name_attempts(part: PartReader, rows: NDArray[np.int64]) -> str:
    """Return the names of attempts for a sentence, the first of many."""
    trials = part.rows(part.layout.trials)[rows]
    names = [f"trial {row['trial_id']}, attempt {row['attempt']}" for row in trials[:_MAX_NAMED]]
    if len(trials) > _MAX_NAMED:
        names.append(f"{len(trials) - _MAX_NAMED} more trials")
    return " and ".join(filter(None, ("; ".join(names[:-1]), *names[-1:]))) or "no trial"


def _selections(part: PartReader) -> dict[str, Callable[[StructuredArray, RowRange], Mask]]:
    by_time = (layout.EVENTS, layout.DRUM, finger_layout.TRACK, finger_layout.LATENCIES)
    return {
        layout.ARRIVALS.path: partial(_by_samples, part, "first_row"),
        layout.GAPS.path: partial(_by_samples, part, "row"),
        layout.LOADCELL.path: partial(_by_board_time, part),
        **{table.path: partial(_by_time, part) for table in by_time},
        **{table.path: partial(_by_scan, part) for table in _BY_SCAN},
    }


def _with_samples(trials: StructuredArray, first: float, last: float) -> Mask:
    start = trials["first_sample"]
    mask: Mask = (start >= 0) & (start <= last) & (start + trials["count"] > first)
    return mask


def _by_samples(part: PartReader, column: str, trials: StructuredArray, place: RowRange) -> Mask:
    return _with_samples(trials, *_neighbours(part, place, column))


def _by_time(part: PartReader, trials: StructuredArray, place: RowRange) -> Mask:
    first, last = _neighbours(part, place, "at_s")
    return _during(trials, first, last)


def _by_board_time(part: PartReader, trials: StructuredArray, place: RowRange) -> Mask:
    first_us, last_us = _neighbours(part, place, "board_time_us")
    polls = part.rows(layout.DRUM)
    before = polls["at_s"][polls["board_time_us"] <= first_us]
    after = polls["at_s"][polls["board_time_us"] >= last_us]
    return _during(
        trials,
        before.max() if len(before) else -np.inf,
        after.min() if len(after) else np.inf,
    )


def _during(trials: StructuredArray, first_s: float, last_s: float) -> Mask:
    mask: Mask = (trials["started_s"] <= last_s) & (trials["ended_s"] >= first_s)
    return mask


def _by_scan(part: PartReader, trials: StructuredArray, place: RowRange) -> Mask:
    first, last = _neighbours(part, place, "scan")
    mask: Mask = (trials["scan"] >= first) & (trials["scan"] <= last)
    return mask


def _neighbours(part: PartReader, place: RowRange, column: str) -> tuple[Any, Any]:
    """Return a column's value in the row before a range and in the one after it."""
    end = place.first_row + place.n_rows
    before = part.stored_rows(place.table, max(0, place.first_row - 1), place.first_row)[column]
    after = part.stored_rows(place.table, end, end + 1)[column]
    return (
        before[0] if len(before) else -np.inf,
        after[0] if len(after) else np.inf,
    )
