"""Check one part of a drum session: the checks of every part, polls, and the sync line."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from rigctl.session.format import layout
from rigctl.session.format.layout import COUNTER, EDGES, FLAGS
from rigctl.session.format.metadata.header import CUT_BY_CLOCK
from rigctl.session.format.table_rows import parse_trial
from rigctl.session.read.buffered_array import read_blocks
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.verify.part_checks import (
    AttemptWindow,
    Columns,
    attempt_windows,
    check_attempt,
    check_contents,
    check_overlap,
    check_window,
    read_columns,
    window_rows,
)
from rigctl.wire.taxels.frames import Flag

RISES = 0b11
MAX_WINDOW_S = 1e6
"""Longer than any trial, and short enough to be counted in samples."""


def check_part(part: PartReader, trials: StructuredArray) -> tuple[list[str], list[str]]:
    """Return problems and notes of one part and of its rows of /trials, one line each."""
    columns = read_columns(part, COUNTER, FLAGS, EDGES)
    rows = attempt_windows(trials)
    has_sync = part.header.cut_by != CUT_BY_CLOCK and _has_sync(columns, rows)
    problems = [*check_contents(part), *_check_drum(part)]
    for row, stored in zip(rows, trials, strict=True):
        lines = [*check_attempt(row), *_check_length(row, stored)]
        lines += check_window(columns, part.n_samples, row)
        window = window_rows(columns, part.n_samples, row)
        if has_sync and window:
            lines += _check_sync(columns, window.start, window.stop)
        problems += [f"{row.name}: {line}" for line in lines]
    problems += check_overlap(rows)
    return problems, list(_notes(part, rows, has_sync))


def _check_length(row: AttemptWindow, stored: np.void) -> Iterator[str]:
    speed_mm_s, travel_mm = float(stored["speed_mm_s"]), float(stored["travel_mm"])
    if not (speed_mm_s > 0 and 0 <= travel_mm <= speed_mm_s * MAX_WINDOW_S):
        yield f"a window of {travel_mm:g} mm at {speed_mm_s:g} mm/s cannot be recorded"
        return
    planned = parse_trial(stored).trial.n_samples
    if row.committed and row.count != planned:
        yield f"it has {row.count} samples, the plan has {planned}"


def _check_drum(part: PartReader) -> Iterator[str]:
    at_s = part.rows(layout.DRUM)["at_s"]
    if np.any(at_s[1:] < at_s[:-1]):
        yield "/drum goes back in time"
    sequence = part.rows(layout.LOADCELL)["sequence"]
    if np.any(np.diff(sequence) <= 0):
        yield "/loadcell holds a conversion twice or out of order"


def _notes(part: PartReader, rows: list[AttemptWindow], has_sync: bool) -> Iterator[str]:
    windows = sum(row.first_counter >= 0 for row in rows)
    spare = _rises(part) - windows
    if part.header.cut_by == CUT_BY_CLOCK:
        yield "no sync wire is fitted: the drum's clock marks the trials"
    elif windows and not has_sync:
        yield "the sync line was never high, so it does not mark the trials"
    elif spare > 0:
        yield f"rises of the sync line that belong to no trial: {spare}"


def _rises(part: PartReader) -> int:
    """Return the number of rises of the sync line in the part's samples."""
    total, last = 0, None
    for _, edges in read_blocks(partial(part.read, EDGES), part.n_samples):
        counts = edges & RISES
        before = counts[0] if last is None else last
        total += int(np.sum(np.diff(counts, prepend=before) & RISES))
        last = counts[-1]
    return total


def _check_sync(columns: Columns, start: int, stop: int) -> Iterator[str]:
    """Check that sync is high in the whole window and rises in the frame before the first."""
    flags = columns[FLAGS].window(start, stop)
    low = np.count_nonzero((flags & Flag.SYNC) == 0)
    if low:
        yield f"the sync line was low in {low} samples of its window"
    if start < 2:
        return
    counters = columns[COUNTER].window(start - 2, start + 1)
    rises = columns[EDGES].window(start - 2, start + 1) & RISES
    if np.array_equal(np.diff(counters), [1, 1]) and rises[0] == rises[1]:
        yield "it does not begin at a rise of the sync line"
    if rises[1] != rises[2]:
        yield "the sync line rose again in its first sample"


def _has_sync(columns: Columns, rows: list[AttemptWindow]) -> bool:
    """Return whether the sync wire is fitted: it is high in some window."""
    for row in rows:
        if row.first_sample >= 0:
            flags = columns[FLAGS].window(row.first_sample, row.first_sample + row.count)
            if np.any(flags & Flag.SYNC):
                return True
    return False
