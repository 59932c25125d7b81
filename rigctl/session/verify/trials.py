"""Check the trials of one part: each window is complete, in the data, and in sync."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part import PartReader
from rigctl.values import TrialRow, Verdict
from rigctl.wire.taxels.frames import Flag

RISES = 0b11
COUNTER, FLAGS, EDGES = "/taxels/counter", "/taxels/flags", "/taxels/edges"

Columns = dict[str, BufferedArray]
"""Small columns of a part's samples, read about once for trials in their order."""


def check_trials(part: PartReader, rows: list[TrialRow]) -> tuple[list[str], list[str]]:
    """Return problems and notes about the attempts in one part, one line each."""
    n = part.n_samples
    columns = {path: BufferedArray(partial(part.read, path), n) for path in (COUNTER, FLAGS, EDGES)}
    has_sync = part.header.cut_by != CUT_BY_CLOCK and _has_sync(columns, rows)
    problems = []
    for row in rows:
        name = f"trial {row.trial.trial_id}, attempt {row.attempt}"
        lines = (*_check_row(row), *_check_window(columns, n, row, has_sync))
        problems += [f"{name}: {line}" for line in lines]
    problems += _check_overlap(rows)
    return problems, list(_notes(part, rows, has_sync))


def _notes(part: PartReader, rows: list[TrialRow], has_sync: bool) -> Iterator[str]:
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


def _check_row(row: TrialRow) -> Iterator[str]:
    committed = row.verdict is Verdict.COMMITTED
    if row.ended_s < row.started_s:
        yield "it ended before it began"
    if committed and row.count != row.trial.n_samples:
        yield f"it has {row.count} samples, the plan has {row.trial.n_samples}"
    if committed and row.first_counter < 0:
        yield "it is committed without a window"


def _check_window(columns: Columns, n_samples: int, row: TrialRow, has_sync: bool) -> Iterator[str]:
    first, end = row.first_counter, row.first_counter + row.count
    if first < 0 or row.verdict is not Verdict.COMMITTED:
        return
    start = row.first_sample
    stop = min(start + row.count, n_samples)
    if not 0 <= start < stop:
        yield f"its first sample, row {start}, is not among the {n_samples} of the part"
        return
    counters = columns[COUNTER].window(max(0, start - 1), stop)
    before, own = (counters[0], counters[1:]) if start else (first - 1, counters)
    if own[0] < first or before >= first:
        yield f"row {start} is not the first sample from counter {first}"
    if own[-1] < end - 1 and stop == n_samples:
        yield f"it ends at counter {end - 1}, the part's samples end at {own[-1]}"
    if has_sync:
        inside = int(np.searchsorted(own, end))
        yield from _check_sync(columns, start, start + inside)


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


def _check_overlap(rows: list[TrialRow]) -> Iterator[str]:
    windows = sorted(
        (row.first_counter, row.first_counter + row.count, row.trial.trial_id)
        for row in rows
        if row.verdict is Verdict.COMMITTED and row.first_counter >= 0
    )
    for (_, end, one), (first, _, other) in pairwise(windows):
        if first < end:
            yield f"trials {one} and {other} overlap"


def _has_sync(columns: Columns, rows: list[TrialRow]) -> bool:
    """Return whether the sync wire is fitted: it is high in some window."""
    for row in rows:
        if row.first_sample >= 0:
            flags = columns[FLAGS].window(row.first_sample, row.first_sample + row.count)
            if np.any(flags & Flag.SYNC):
                return True
    return False
