"""Check that the values of a part are ones that a rig can record: ranges, samples and tables."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.boards.drum_codes import Status
from rigctl.boards.drum_states import Fault, State
from rigctl.session import layout
from rigctl.session.header import IMPORTED
from rigctl.session.layout import COUNTER, EDGES, SAMPLES, TableLayout
from rigctl.session.part import PartReader, StructuredArray, read_blocks
from rigctl.values import SCALE_BAND_UG_PER_COUNT, Verdict

Column = NDArray[Any]
Mask = NDArray[np.bool_]

MAX_S = 1e9
"""Of any time in a session, thirty years."""


class Rule(NamedTuple):
    """A rule for a column: ``is_right`` returns bool (n,) for its values; ``words``: what fits."""

    column: str
    is_right: Callable[[Column], Mask]
    words: str


def within(column: str, low: float, high: float, unknown: bool = False) -> Rule:
    """Return the rule that values lie from ``low`` to ``high``; ``unknown`` allows NaN."""

    def is_right(values: Column) -> Mask:
        inside: Mask = (values >= low) & (values <= high)
        return inside | np.isnan(values) if unknown else inside

    return Rule(column, is_right, f"not from {low:g} to {high:g}")


def at_least(column: str, low: int) -> Rule:
    """Return the rule that whole numbers are not below ``low``."""
    return Rule(column, lambda values: values >= low, f"below {low}")


def a_time(column: str, unknown: bool = False) -> Rule:
    """Return the rule for a loop time in seconds."""
    return within(column, -MAX_S, MAX_S, unknown)


def one_of(column: str, known: Iterable[Any]) -> Rule:
    """Return the rule that values are among the ``known`` ones."""
    listed = [each.value if isinstance(each, Enum) else each for each in known]
    return Rule(column, lambda values: np.isin(values, listed), "no known value")


def bits(column: str, mask: int) -> Rule:
    """Return the rule that no bit outside ``mask`` is set."""
    return Rule(column, lambda values: (values & ~np.array(mask, values.dtype)) == 0, "has bits "
                "without a meaning")  # fmt: skip


def json_objects(column: str) -> Rule:
    """Return the rule that texts are JSON objects."""
    return Rule(column, _are_objects, "not a JSON object")


def check_rules(path: str, rows: StructuredArray, rules: Iterable[Rule]) -> Iterator[str]:
    """Yield a sentence for each rule that rows of a table break."""
    for rule in rules:
        values = rows[rule.column]
        wrong = np.flatnonzero(~rule.is_right(values))
        if len(wrong):
            yield describe_wrong(f"{rule.column} of {path}", wrong, values, rule.words)


def describe_wrong(what: str, wrong: NDArray[np.int64], values: Column, words: str) -> str:
    """Return a sentence on wrong rows: the first one with its value, and the number of others."""
    shown = str(values[wrong[0]])[:60]
    others = f", and in {len(wrong) - 1} more rows" if len(wrong) > 1 else ""
    return f"{what} is {shown} in row {wrong[0]}, {words}{others}"


def check_ascent(what: str, values: Column) -> Iterator[str]:
    """Yield a sentence where a column runs back."""
    back = np.flatnonzero(values[1:] < values[:-1]) + 1
    if len(back):
        others = f" and {len(back) - 1} more" if len(back) > 1 else ""
        yield f"{what} runs back at row {back[0]}{others}"


def _are_objects(texts: Column) -> Mask:
    return np.fromiter(map(_is_object, texts.tolist()), np.bool_, len(texts))


def _is_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return False


HIGHEST_COUNT = 1 << 23
"""The load cell's converter has 24 bits with a sign."""
MAX_FORCE_G = 2 * HIGHEST_COUNT * SCALE_BAND_UG_PER_COUNT[1] * 1e-6
"""No cell reads more: the converter's whole span, with the coarsest scale."""
MAX_MM, MAX_MM_S = 1e6, 1e5
MAX_U32 = (1 << 32) - 1
_FAULT_BITS = sum(1 << fault for fault in Fault if fault)
_STATUS_BITS = sum(1 << bit for bit in Status)

_GAPS = (at_least("count", 1), at_least("row", 0))
ATTEMPT_RULES = (
    at_least("trial_id", 1),
    at_least("attempt", 1),
    at_least("first_counter", -1),
    at_least("first_sample", -1),
    at_least("count", 0),
    one_of("verdict", Verdict),
    a_time("started_s"),
    a_time("ended_s"),
)
COMMON_RULES: dict[str, tuple[Rule, ...]] = {
    layout.ARRIVALS.path: (at_least("first_row", 0), a_time("arrived_s")),
    layout.EVENTS.path: (a_time("at_s"), json_objects("data")),
    layout.GAPS.path: _GAPS,
}


def drum_rules(measured: bool) -> dict[str, tuple[Rule, ...]]:
    """Return the rules of the drum's tables; an import has forces and speeds only if ``measured``.

    A NaN stands for what was not measured.
    """
    unknown = not measured
    drum = (
        a_time("at_s"),
        at_least("board_time_us", 0),
        one_of("state", State),
        one_of("fault", Fault),
        bits("fault_bits", _FAULT_BITS),
        bits("status_bits", _STATUS_BITS),
        within("angle_deg", -MAX_MM, MAX_MM),
        within("speed_mm_s", -MAX_MM_S, MAX_MM_S, unknown),
        within("speed_set_mm_s", -MAX_MM_S, MAX_MM_S, unknown),
        within("force_g", -MAX_FORCE_G, MAX_FORCE_G, unknown),
        within("force_set_g", -MAX_FORCE_G, MAX_FORCE_G, unknown),
        within("actuator_drive_permille", -1000, 1000),
        at_least("sync_count", 0),
        at_least("index_count", 0),
        at_least("loadcell_lost", 0),
    )
    loadcell = (
        at_least("sequence", 0),
        at_least("board_time_us", -MAX_CLOCK_LEAD_US),
        within("raw_counts", -HIGHEST_COUNT, HIGHEST_COUNT),
        within("force_g", -MAX_FORCE_G, MAX_FORCE_G),
    )
    trials = (
        *ATTEMPT_RULES,
        within("speed_mm_s", 0, MAX_MM_S),
        within("force_g", 0, MAX_FORCE_G),
        within("travel_mm", 0, MAX_MM),
        within("depth_mm", -MAX_MM, MAX_MM),
        within("mean_speed_mm_s", -MAX_MM_S, MAX_MM_S, unknown=True),
        within("mean_force_g", -MAX_FORCE_G, MAX_FORCE_G, unknown=True),
        at_least("mount", 1),
    )
    tables = (layout.DRUM, layout.LOADCELL, layout.TRIALS)
    rules = zip(tables, (drum, loadcell, trials), strict=True)
    return COMMON_RULES | {table.path: each for table, each in rules}


MAX_CLOCK_LEAD_US = 1_000_000
"""The first conversion may be from before the board's clock began, by as much."""


Floats = NDArray[np.float64]

MIN_STEP_COUNTS = 100
MIN_STEPS = 20
"""Steps of the force that a scale is found from."""
TOLERANCE_G = 2.0
"""Far above what a tare that depends on the drum's angle changes between two conversions."""
UG_PER_G = 1e6
CHANGED_SHARE = 0.01
"""A larger share of forces that do not fit means another scale, set in the middle of a part."""


def check_scale(rows: StructuredArray) -> Iterator[str]:
    """Check the forces of one part against its counts; ``rows``: /loadcell, in order."""
    raw, force_g = rows["raw_counts"].astype(np.float64), rows["force_g"].astype(np.float64)
    scale_g = _scale(raw, force_g) if np.isfinite(force_g).all() else None
    if scale_g is None:
        return
    low, high = SCALE_BAND_UG_PER_COUNT
    if not low * 0.99 <= abs(scale_g) * UG_PER_G <= high * 1.01:
        yield (
            f"the forces of /loadcell are {abs(scale_g) * UG_PER_G:.4g} µg a count, a load cell "
            f"has {low} to {high}"
        )
        return
    odd = _lone(force_g - scale_g * raw)
    if 0 < len(odd) <= max(1, CHANGED_SHARE * len(rows)):
        yield describe_wrong(
            "force_g of /loadcell", odd, rows["force_g"], "its raw_counts give another force"
        )


def note_saturation(rows: StructuredArray) -> Iterator[str]:
    """Note conversions at the end of the converter's range: a fault of the rig, not of the file."""
    at_end = np.count_nonzero(np.abs(rows["raw_counts"].astype(np.int64)) >= HIGHEST_COUNT - 1)
    if at_end:
        yield f"the load cell was at the end of its range in {at_end} conversions"


def _scale(raw: Floats, force_g: Floats) -> float | None:
    """Return the median of force over counts in steps, g a count; None without enough steps."""
    steps, steps_g = np.diff(raw), np.diff(force_g)
    large = np.abs(steps) >= MIN_STEP_COUNTS
    if np.count_nonzero(large) < MIN_STEPS:
        return None
    return float(np.median(steps_g[large] / steps[large]))


def _lone(tare_g: Floats) -> NDArray[np.int64]:
    """Return single rows whose tare is neither that of the row before nor that of the next."""
    before, after = np.abs(np.diff(tare_g))[:-1], np.abs(np.diff(tare_g))[1:]
    across = np.abs(tare_g[2:] - tare_g[:-2])
    lone: NDArray[np.int64] = (
        np.flatnonzero((before > TOLERANCE_G) & (after > TOLERANCE_G) & (across < TOLERANCE_G / 2))
        + 1
    )
    return lone


EDGE_BITS = 0b1111
LINK_KIND = "link"
"""Kind of the event at which a board was lost or came back."""


def check_values(part: PartReader) -> tuple[list[str], list[str]]:
    """Return problems and notes on the values of a part of the drum, one line each."""
    rules = drum_rules(measured=part.header.rig != IMPORTED)
    problems, notes = check_recorded(part, rules, EDGES, EDGE_BITS)
    return [*problems, *_check_drum(part, notes)], notes


def check_recorded(
    part: PartReader, rules: Mapping[str, tuple[Rule, ...]], bits: str, known_bits: int
) -> tuple[list[str], list[str]]:
    """Return problems and notes on what the parts of all experiments hold.

    ``rules``: those of each table's columns, by its path; ``bits``: the array whose values have no
    bits but ``known_bits``.
    """
    notes: list[str] = []
    samples = _check_samples(part, bits, known_bits)
    return [*_check_ranges(part, notes), *samples, *_check_tables(part, rules)], notes


def _check_ranges(part: PartReader, notes: list[str]) -> Iterator[str]:
    header = part.header
    pairs = zip(header.taxel_low, header.taxel_high, strict=False)
    for taxel, (low, high) in enumerate(pairs, start=1):
        if low > high:
            yield f"the range of taxel {taxel} begins at {low} and ends at {high}, below it"
        elif low == high:
            notes.append(f"the range of taxel {taxel} is the single reading {low}")


def _check_samples(part: PartReader, bits: str, known_bits: int) -> Iterator[str]:
    n, highest = part.n_samples, part.header.highest_reading
    if highest < np.iinfo(np.uint16).max:
        yield from _check_highest(part, SAMPLES, highest, "above the converter's highest reading")
    yield from _check_highest(part, bits, known_bits, "has bits without a meaning")
    if n and int(part.read(COUNTER, 0, 1)[0]) < 0:
        yield f"{COUNTER} begins below 0"


def _check_highest(part: PartReader, path: str, highest: int, words: str) -> Iterator[str]:
    for start, rows in read_blocks(partial(part.read, path), part.n_samples):
        if rows.max() > highest:
            wrong = np.flatnonzero((rows.reshape(len(rows), -1) > highest).any(axis=1))
            value = rows[wrong[0]].max()
            yield f"{path} is {value} in row {start + int(wrong[0])}, {words} ({highest})"
            return


def _check_tables(part: PartReader, rules: Mapping[str, tuple[Rule, ...]]) -> Iterator[str]:
    measured = part.header.rig != IMPORTED
    for table in part.layout.tables:
        rows = part.rows(table)
        if table is part.layout.trials:
            rows = _written(part, rows)
            yield from _check_means(rows, measured)
        yield from check_rules(table.path, rows, rules[table.path])
    yield from check_times(part, layout.EVENTS)


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


def check_times(part: PartReader, *tables: TableLayout) -> Iterator[str]:
    """Check that the loop times of tables ascend."""
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
