"""What must hold in one part whatever its trials: lengths, counters, gaps, times, descriptions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigctl.session.format import layout
from rigctl.session.read.part import PartReader

SLICE_ROWS = 500_000


def check_part(part: PartReader) -> list[str]:
    """Problems of one part, a line each."""
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
    """Counters ascend, and every jump is a row of /gaps and the other way round."""
    jumps: dict[int, tuple[int, int]] = {}
    last: int | None = None
    first: int | None = None
    for start in range(0, part.n_samples, SLICE_ROWS):
        counters = part.read("/taxels/counter", start, start + SLICE_ROWS).astype(np.int64)
        first = int(counters[0]) if first is None else first
        steps = np.diff(counters, prepend=counters[0] - 1 if last is None else last)
        if np.any(steps <= 0):
            yield f"the sample counter goes back at row {start + int(np.argmax(steps <= 0))}"
            return
        for place in np.flatnonzero(steps > 1):
            count = int(steps[place]) - 1
            jumps[int(counters[place]) - count] = (count, start + int(place))
        last = int(counters[-1])
    yield from _check_gaps(part, jumps, first, last)


def _check_gaps(
    part: PartReader, jumps: dict[int, tuple[int, int]], first: int | None, last: int | None
) -> Iterator[str]:
    gaps = part.rows(layout.GAPS)
    told = _merged(gaps["first_counter"], gaps["count"])
    for counter, count in told:
        outside = first is None or last is None or counter + count <= first or counter > last
        if outside and (count > 0):
            continue  # lost before the first or behind the last sample of this part
        if jumps.pop(counter, (0, 0))[0] != count:
            yield f"/gaps tells of {count} lost samples from counter {counter}, the samples do not"
    for counter, (count, row) in jumps.items():
        yield f"{count} samples from counter {counter} are missing at row {row}, not in /gaps"


def _merged(first: NDArray[np.int64], count: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Gaps that follow each other directly are one jump of the counter."""
    merged: list[tuple[int, int]] = []
    for place in np.argsort(first, kind="stable"):
        start, length = int(first[place]), int(count[place])
        if merged and start == sum(merged[-1]):
            merged[-1] = (merged[-1][0], merged[-1][1] + length)
        else:
            merged.append((start, length))
    return merged


def _check_arrivals(part: PartReader) -> Iterator[str]:
    arrivals = part.rows(layout.ARRIVALS)
    if np.any(np.diff(arrivals["first_row"]) <= 0):
        yield "/taxels/arrivals does not ascend in first_row"
    if np.any(np.diff(arrivals["arrived_s"]) < 0):
        yield "/taxels/arrivals goes back in time"
    if part.finished and len(arrivals) and arrivals["first_row"][-1] >= part.n_samples:
        yield "/taxels/arrivals names samples that are not there"


def _check_drum(part: PartReader) -> Iterator[str]:
    drum = part.rows(layout.DRUM)
    if np.any(np.diff(drum["at_s"]) < 0):
        yield "/drum goes back in time"
    sequence = part.rows(layout.LOADCELL)["sequence"]
    if np.any(np.diff(sequence) <= 0):
        yield "/loadcell holds a conversion twice or out of order"


def _check_descriptions(part: PartReader) -> Iterator[str]:
    documentation = part.documentation()
    for path, attributes in documentation.items():
        for name in ("doc", "shape"):
            if not attributes.get(name):
                yield f"{path} has no attribute {name}"
    for array in layout.TAXEL_ARRAYS:
        if "unit" not in documentation[array.path]:
            yield f"{array.path} has no attribute unit"
    for table in layout.TABLES:
        if len(documentation[table.path].get("columns", ())) != len(table.columns):
            yield f"{table.path} does not describe its columns"
