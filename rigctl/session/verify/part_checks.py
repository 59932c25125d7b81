"""Checks that parts of every layout pass: lengths, counters, gaps, times, windows of trials."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.format.layout import COUNTER
from rigctl.session.read.buffered_array import BufferedArray, read_blocks
from rigctl.session.read.part import PartReader, StructuredArray
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
