"""Check one part apart from its trials: lengths, counters, gaps, times, descriptions."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.read.buffered_array import read_blocks
from rigctl.session.read.part import PartReader


def check_part(part: PartReader) -> list[str]:
    """Return the problems of one part, one line each."""
    return [
        *_check_lengths(part),
        *_check_counters(part),
        *_check_arrivals(part),
        *_check_drum(part),
        *_check_descriptions(part),
    ]


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
    for start, counters in read_blocks(partial(part.read, "/taxels/counter"), part.n_samples):
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
