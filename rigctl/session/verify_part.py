"""Check one part: lengths, counters, gaps, times, windows of trials; of the drum polls and sync."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.taxel_frames import Flag
from rigctl.session import layout
from rigctl.session.header import CUT_BY_CLOCK
from rigctl.session.layout import COUNTER, EDGES, FLAGS, parse_trial
from rigctl.session.part import BufferedArray, PartReader, StructuredArray, read_blocks
from rigctl.values import Verdict

Columns = dict[str, BufferedArray]
"""Small columns of a part's samples, read about once for trials in their order."""


@dataclass(frozen=True, slots=True)
class AttemptWindow:
    """What the tables of every experiment say about an attempt at a trial."""

    trial_id: int
    attempt: int
    verdict: str
    first_counter: int
    first_sample: int
    count: int
    started_s: float
    ended_s: float

    @property
    def committed(self) -> bool:
        """Whether the attempt counts."""
        return self.verdict == Verdict.COMMITTED

    @property
    def name(self) -> str:
        """Name of the attempt for a finding."""
        return f"trial {self.trial_id}, attempt {self.attempt}"


def attempt_windows(rows: StructuredArray) -> list[AttemptWindow]:
    """Return the attempts in rows of /trials."""
    names = [field.name for field in fields(AttemptWindow)]
    return [AttemptWindow(*row) for row in rows[names].tolist()]


def read_columns(part: PartReader, *paths: str) -> Columns:
    """Return buffered columns of a part's samples."""
    return {path: BufferedArray(partial(part.read, path), part.n_samples) for path in paths}


def check_contents(part: PartReader) -> Iterator[str]:
    """Check what does not depend on trials: lengths, counters, gaps, arrivals, descriptions."""
    yield from _check_lengths(part)
    yield from _check_counters(part)
    yield from _check_arrivals(part)
    yield from _check_descriptions(part)


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
    first_rows, arrived_s = arrivals["first_row"], arrivals["arrived_s"]
    if np.any(first_rows[1:] <= first_rows[:-1]):
        yield "first_row of /taxels/arrivals does not ascend"
    if np.any(arrived_s[1:] < arrived_s[:-1]):
        yield "/taxels/arrivals goes back in time"
    if part.finished and len(arrivals) and arrivals["first_row"][-1] >= part.n_samples:
        yield "/taxels/arrivals lists samples that are missing"


def _check_descriptions(part: PartReader) -> Iterator[str]:
    attributes_of = part.dataset_attributes()
    for path, attributes in attributes_of.items():
        for name in ("doc", "shape"):
            if not attributes.get(name):
                yield f"{path} has no attribute {name}"
    for array in part.layout.arrays:
        if "unit" not in attributes_of[array.path]:
            yield f"{array.path} has no attribute unit"
    for table in part.layout.tables:
        stored = part.file.dtype(table.path).names or ()
        described = np.atleast_1d(attributes_of[table.path].get("columns", ()))
        if len(described) != len(stored):
            yield f"{table.path} does not describe its columns"


def check_attempt(row: AttemptWindow) -> Iterator[str]:
    """Check the times of an attempt, and that a committed one has samples."""
    if row.ended_s < row.started_s:
        yield "it ended before it began"
    if row.committed and row.first_counter < 0:
        yield "it is committed without a window"


def check_window(columns: Columns, n_samples: int, row: AttemptWindow) -> Iterator[str]:
    """Check that a committed window begins and ends where its row says."""
    first, end = row.first_counter, row.first_counter + row.count
    if first < 0 or not row.committed:
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


def window_rows(columns: Columns, n_samples: int, row: AttemptWindow) -> range:
    """Return the rows of a committed window in the part's samples, empty where there are none."""
    start, stop = row.first_sample, min(row.first_sample + row.count, n_samples)
    if not row.committed or row.first_counter < 0 or not 0 <= start < stop:
        return range(0)
    counters = columns[COUNTER].window(start, stop)
    return range(start, start + int(np.searchsorted(counters, row.first_counter + row.count)))


def check_overlap(rows: list[AttemptWindow]) -> Iterator[str]:
    """Check that no two committed windows share samples."""
    windows = sorted(
        (row.first_counter, row.first_counter + row.count, row.trial_id)
        for row in rows
        if row.committed and row.first_counter >= 0
    )
    for (_, end, one), (first, _, other) in pairwise(windows):
        if first < end:
            yield f"trials {one} and {other} overlap"


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
