"""Check the values of one part: its ranges, samples and tables."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from rigctl.session.format import layout
from rigctl.session.format.data_sets import TableLayout
from rigctl.session.format.finger_layout import FINGER_LAYOUT, PREDICTIONS, TRACK
from rigctl.session.format.layout import COUNTER, EDGES, FLAGS, SAMPLES
from rigctl.session.format.metadata.header import IMPORTED
from rigctl.session.read.buffered_array import read_blocks
from rigctl.session.read.part import PartReader, StructuredArray
from rigctl.session.verify.values.loadcell import check_scale, note_saturation
from rigctl.session.verify.values.rules import (
    check_ascent,
    check_rules,
    describe_wrong,
)
from rigctl.session.verify.values.tables import drum_rules, finger_rules
from rigctl.values import Verdict
from rigctl.wire.finger.messages import SampleFlag

EDGE_BITS = 0b1111
FINGER_FLAGS = sum(SampleFlag)
LINK_KIND = "link"
"""Kind of the event at which a board was lost or came back."""


def check_values(part: PartReader) -> tuple[list[str], list[str]]:
    """Return problems and notes on the values of a part, one line each."""
    notes: list[str] = []
    problems = [*_check_ranges(part, notes), *_check_samples(part), *_check_tables(part)]
    if part.layout is FINGER_LAYOUT:
        problems += _check_times(part, (TRACK, PREDICTIONS))
    else:
        problems += _check_drum(part, notes)
    return problems, notes


def _check_ranges(part: PartReader, notes: list[str]) -> Iterator[str]:
    header = part.header
    pairs = zip(header.taxel_low, header.taxel_high, strict=False)
    for taxel, (low, high) in enumerate(pairs, start=1):
        if low > high:
            yield f"the range of taxel {taxel} begins at {low} and ends at {high}, below it"
        elif low == high:
            notes.append(f"the range of taxel {taxel} is the single reading {low}")


def _check_samples(part: PartReader) -> Iterator[str]:
    n, highest = part.n_samples, part.header.highest_reading
    if highest < np.iinfo(np.uint16).max:
        yield from _check_highest(part, SAMPLES, highest, "above the converter's highest reading")
    if part.layout is FINGER_LAYOUT:
        yield from _check_highest(part, FLAGS, FINGER_FLAGS, "has bits without a meaning")
    else:
        yield from _check_highest(part, EDGES, EDGE_BITS, "has bits without a meaning")
    if n and int(part.read(COUNTER, 0, 1)[0]) < 0:
        yield f"{COUNTER} begins below 0"


def _check_highest(part: PartReader, path: str, highest: int, words: str) -> Iterator[str]:
    for start, rows in read_blocks(partial(part.read, path), part.n_samples):
        if rows.max() > highest:
            wrong = np.flatnonzero((rows.reshape(len(rows), -1) > highest).any(axis=1))
            value = rows[wrong[0]].max()
            yield f"{path} is {value} in row {start + int(wrong[0])}, {words} ({highest})"
            return


def _check_tables(part: PartReader) -> Iterator[str]:
    measured = part.header.rig != IMPORTED
    rules = finger_rules() if part.layout is FINGER_LAYOUT else drum_rules(measured)
    for table in part.layout.tables:
        rows = part.rows(table)
        if table is part.layout.trials:
            rows = _written(part, rows)
            yield from _check_means(rows, measured)
        yield from check_rules(table.path, rows, rules[table.path])
    yield from _check_times(part, (layout.EVENTS,))


def _written(part: PartReader, trials: StructuredArray) -> StructuredArray:
    """Return the rows of /trials without those that a crash left empty."""
    if part.finished:
        return trials
    kept: StructuredArray = trials[np.isin(trials["verdict"], list(Verdict))]
    return kept


def _check_means(trials: StructuredArray, measured: bool) -> Iterator[str]:
    """Check that what a committed attempt's verdict rests on was measured."""
    committed = trials["verdict"] == Verdict.COMMITTED
    for name in ("mean_speed_mm_s", "mean_force_g", "mean_mm_s"):
        if measured and name in (trials.dtype.names or ()):
            wrong = np.flatnonzero(committed & ~np.isfinite(trials[name]))
            if len(wrong):
                yield describe_wrong(
                    f"{name} of /trials", wrong, trials[name], "though the attempt is committed"
                )


def _check_times(part: PartReader, tables: tuple[TableLayout, ...]) -> Iterator[str]:
    for table in tables:
        yield from check_ascent(f"at_s of {table.path}", part.rows(table)["at_s"])


def _check_drum(part: PartReader, notes: list[str]) -> Iterator[str]:
    """Check the drum's clock and load cell; both begin anew where the drum was lost meanwhile."""
    loadcell = part.rows(layout.LOADCELL)
    polls = part.rows(layout.DRUM)
    notes += note_saturation(loadcell)
    lost = len(part.rows_where(layout.EVENTS, "kind", LINK_KIND))
    for path, rows in ((layout.DRUM.path, polls), (layout.LOADCELL.path, loadcell)):
        found = list(check_ascent(f"board_time_us of {path}", rows["board_time_us"]))
        if np.count_nonzero(np.diff(rows["board_time_us"]) < 0) <= lost:
            notes += [f"{line}: the drum was connected again" for line in found]
        else:
            yield from found
    if part.header.rig != IMPORTED:
        yield from check_scale(loadcell)
