"""Check one part: lengths, counters, gaps, times, descriptions, and the windows of its trials."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.format.header import CUT_BY_CLOCK
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part import PartReader
from rigctl.values import TrialRow, Verdict
from rigctl.wire.taxels.frames import Flag

RISES = 0b11
COUNTER, FLAGS, EDGES = "/taxels/counter", "/taxels/flags", "/taxels/edges"

Columns = dict[str, BufferedArray]
"""Small columns of a part's samples, read about once for trials in their order."""


def check_part(part: PartReader, rows: list[TrialRow]) -> tuple[list[str], list[str]]:
    """Return problems and notes of one part and of its attempts, one line each."""
    n = part.n_samples
    columns = {path: BufferedArray(partial(part.read, path), n) for path in (COUNTER, FLAGS, EDGES)}
    has_sync = part.header.cut_by != CUT_BY_CLOCK and _has_sync(columns, rows)
    problems = [
        *_check_lengths(part),
        *_check_counters(part),
        *_check_arrivals(part),
        *_check_drum(part),
        *_check_descriptions(part),
    ]
    for row in rows:
        name = f"trial {row.trial.trial_id}, attempt {row.attempt}"
        lines = (*_check_row(row), *_check_window(columns, n, row, has_sync))
        problems += [f"{name}: {line}" for line in lines]
    problems += _check_overlap(rows)
    return problems, list(_notes(part, rows, has_sync))


def _check_lengths(part: PartReader) -> Iterator[str]:
    lengths = part.lengths()
    if part.finished and len(set(lengths.values())) > 1:
        listed = ", ".join(f"{path} {n}" for path, n in lengths.items())
        yield f"per-sample data sets differ in length: {listed}"


def _check_counters(part: PartReader) -> Iterator[str]:
    """Check that counters ascend and that their jumps are exactly the rows of /gaps."""
    jumps: dict[int, tuple[int, int]] = {}
    last: int | None = None
    first: int | None = None
    for start, counters in read_blocks(partial(part.read, COUNTER), part.n_samples):
        first = int(counters[0]) if first is None else first
        steps = np.diff(counters, prepend=counters[0] - 1 if last is None else last)
        if np.any(steps <= 0):
            yield f"the sample counter decreases at row {start + int(np.argmax(steps <= 0))}"
            return
        for i in np.flatnonzero(steps > 1):
            count = int(steps[i]) - 1
            jumps[int(counters[i]) - count] = (count, start + int(i))
        last = int(counters[-1])
    yield from _check_gaps(part, jumps, first, last)


def _check_gaps(
    part: PartReader, jumps: dict[int, tuple[int, int]], first: int | None, last: int | None
) -> Iterator[str]:
    gaps = part.rows(layout.GAPS)
    for counter, count in _merge(gaps["first_counter"], gaps["count"]):
        outside = first is None or last is None or counter + count <= first or counter > last
        if outside and count > 0:
            continue  # lost before the first or after the last sample of this part
        if jumps.pop(counter, (0, 0))[0] != count:
            yield f"/gaps lists {count} lost samples from counter {counter}, the samples do not"
    for counter, (count, row) in jumps.items():
        yield f"{count} samples from counter {counter} are missing at row {row}, not in /gaps"


def _merge(first: NDArray[np.int64], count: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Join adjacent gaps, which are one jump of the counter."""
    merged: list[tuple[int, int]] = []
    for i in np.argsort(first, kind="stable"):
        start, length = int(first[i]), int(count[i])
        if merged and start == sum(merged[-1]):
            merged[-1] = (merged[-1][0], merged[-1][1] + length)
        else:
            merged.append((start, length))
    return merged


def _check_arrivals(part: PartReader) -> Iterator[str]:
    arrivals = part.rows(layout.ARRIVALS)
    if np.any(np.diff(arrivals["first_row"]) <= 0):
        yield "first_row of /taxels/arrivals does not ascend"
    if np.any(np.diff(arrivals["arrived_s"]) < 0):
        yield "/taxels/arrivals goes back in time"
    if part.finished and len(arrivals) and arrivals["first_row"][-1] >= part.n_samples:
        yield "/taxels/arrivals lists samples that are missing"


def _check_drum(part: PartReader) -> Iterator[str]:
    drum = part.rows(layout.DRUM)
    if np.any(np.diff(drum["at_s"]) < 0):
        yield "/drum goes back in time"
    sequence = part.rows(layout.LOADCELL)["sequence"]
    if np.any(np.diff(sequence) <= 0):
        yield "/loadcell holds a conversion twice or out of order"


def _check_descriptions(part: PartReader) -> Iterator[str]:
    attributes_of = part.dataset_attributes()
    for path, attributes in attributes_of.items():
        for name in ("doc", "shape"):
            if not attributes.get(name):
                yield f"{path} has no attribute {name}"
    for array in layout.TAXEL_ARRAYS:
        if "unit" not in attributes_of[array.path]:
            yield f"{array.path} has no attribute unit"
    for table in layout.TABLES:
        if len(attributes_of[table.path].get("columns", ())) != len(table.columns):
            yield f"{table.path} does not describe its columns"


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
