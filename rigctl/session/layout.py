"""Describe a session's files: names, data sets, columns, and the rows of the drum's tables.

``docs/reference/session.md`` shows the same tables. The tables of arrivals, events and gaps are
those of every session.

All data sets are created before the first sample, because HDF5 cannot add any to a file in SWMR
mode; strings have a fixed length for the same reason. ``('v110', 'v110')`` is the newest format
that the HDF5 1.10 tools of today's distributions read.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from functools import lru_cache
from math import nan
from operator import attrgetter
from pathlib import Path
from typing import Any
from uuid import uuid4

import h5py
import numpy as np

from rigctl.boards.drum_registers import STORED
from rigctl.experiments import DRUM_EXPERIMENT
from rigctl.session.hdf5_file import (
    Attributes,
    open_image,
    parse_json,
    text_scalar,
    write_attributes,
)
from rigctl.values import DrumState, Event, PlannedTrial, TrialRow, Verdict

LIBVER = ("v110", "v110")
SAMPLE_CHUNK_ROWS = 4096
"""A chunk of samples is 147 kB at 18 taxels: small to rewrite at each flush, large to read."""

TEXTS = (("/protocol_toml", "text of the protocol"), ("/rig_toml", "text of rig.toml"))


@dataclass(frozen=True, slots=True)
class Column:
    """A named value of a row: NumPy type code (``S`` is UTF-8 text), unit, meaning.

    Files of before an ``optional`` one was added lack it: NaN stands for its values.
    """

    name: str
    type_code: str
    unit: str
    doc: str
    optional: bool = False

    @property
    def text_bytes(self) -> int:
        """Length of the stored text, 0 for a number."""
        return int(self.type_code[1:]) if self.type_code.startswith("S") else 0

    @property
    def stored_dtype(self) -> np.dtype[Any]:
        """Little-endian number or fixed-length UTF-8."""
        if not self.text_bytes:
            return np.dtype(f"<{self.type_code}")
        dtype: np.dtype[Any] = h5py.string_dtype("utf-8", self.text_bytes)
        return dtype


@dataclass(frozen=True, slots=True)
class TableLayout:
    """A growing one-dimensional data set whose rows are HDF5 compounds.

    ``place``: the column that says to which trials a row belongs.
    """

    path: str
    doc: str
    chunk_rows: int
    columns: tuple[Column, ...]
    place: str = "at_s"

    @property
    def dtype(self) -> np.dtype[Any]:
        """Row type in the file."""
        return np.dtype([(c.name, c.stored_dtype) for c in self.columns])

    @property
    def optional(self) -> frozenset[str]:
        """Names of the columns that a file may lack."""
        return frozenset(column.name for column in self.columns if column.optional)


DIGESTS = TableLayout(
    "/digests",
    "one row for each block of rows that was written at once; each digest covers those before it",
    128,
    (
        Column("table", "S24", "", "data set of the rows; / for the part's description"),
        Column("first_row", "i8", "rows", "first row that the digest covers"),
        Column("n_rows", "i8", "rows", "number of rows that the digest covers"),
        Column("digest", "S64", "", "SHA-256 of the digest before, the place and the rows"),
    ),
)
"""In every part, whatever its layout."""


@dataclass(frozen=True, slots=True)
class ArrayLayout:
    """A growing data set of plain numbers, one row for each taxel sample.

    ``field`` is the attribute of a :class:`SampleBlock` with its rows. ``per_taxel`` arrays have a
    column for each taxel; a ``raw`` one is in the unit of the part's attribute ``sample_unit``.
    """

    path: str
    field: str
    type_code: str
    unit: str
    doc: str
    per_taxel: bool = False
    raw: bool = False


@dataclass(frozen=True, slots=True)
class SessionLayout:
    """All data sets of the parts of one experiment.

    ``experiment`` is the attribute of a part's root, ``board`` the name of the board that samples,
    for people. ``trials`` is the one of ``tables`` that is written last. ``analysed``: paths of
    what an analysis needs besides them. ``has_digests``: whether its rows are covered by digests.
    ``truth``: columns of the log that a simulated bench writes beside the parts.
    """

    experiment: str
    board: str
    arrays: tuple[ArrayLayout, ...]
    tables: tuple[TableLayout, ...]
    trials: TableLayout
    analysed: tuple[str, ...] = ()
    has_digests: bool = True
    truth: tuple[ArrayLayout, ...] = ()

    @property
    def stored_tables(self) -> tuple[TableLayout, ...]:
        """All tables of a part, that of the digests too."""
        return (*self.tables, DIGESTS) if self.has_digests else self.tables


def build_part(empty: bytes, attributes: Attributes) -> bytes:
    """Return an :func:`empty_part` with these attributes of its own at its root."""
    with open_image(empty) as file:
        write_attributes(file, attributes)
        file.flush()
        return bytes(file.id.get_file_image())


@lru_cache(maxsize=4)
def empty_part(
    layout: SessionLayout,
    n_taxels: int,
    texts: tuple[str, str],
    attributes: tuple[tuple[str, str | int | float], ...],
) -> bytes:
    """Return a part without rows. ``texts``: protocol and rig description.

    Kept, as the parts of a session differ in few attributes of their root.
    """
    sample_unit = str(dict(attributes).get("sample_unit", ""))
    # HDF5 knows files in memory by name, and two threads may each build one.
    name = f"new {uuid4()}"
    with h5py.File(name, "w", driver="core", backing_store=False, libver=LIBVER) as file:
        for array in layout.arrays:
            _create_array(file, array, n_taxels, sample_unit)
        for table in layout.stored_tables:
            _create_table(file, table)
        for (path, doc), text in zip(TEXTS, texts, strict=True):
            write_attributes(file.create_dataset(path, data=text_scalar(text)), {"doc": doc})
        write_attributes(file, dict(attributes))
        file.flush()
        return bytes(file.id.get_file_image())


def _create_array(file: Any, array: ArrayLayout, n_taxels: int, sample_unit: str) -> None:
    tail = (n_taxels,) if array.per_taxel else ()
    dataset = _create(file, array.path, f"<{array.type_code}", SAMPLE_CHUNK_ROWS, tail)
    shape = "(sample, taxel)" if array.per_taxel else "(sample,)"
    unit = sample_unit if array.raw and sample_unit else array.unit or "none"
    write_attributes(dataset, {"doc": array.doc, "unit": unit, "shape": shape})


def _create_table(file: Any, table: TableLayout) -> None:
    dataset = _create(file, table.path, table.dtype, table.chunk_rows)
    write_attributes(dataset, {"doc": table.doc, "shape": "(row,)"})
    lines = [f"{c.name} [{c.unit or 'none'}]: {c.doc}".encode() for c in table.columns]
    width = max(map(len, lines))
    dataset.attrs.create("columns", np.array(lines, dtype=h5py.string_dtype("utf-8", width)))


def _create(file: Any, path: str, dtype: Any, chunk_rows: int, tail: tuple[int, ...] = ()) -> Any:
    return file.create_dataset(
        path, (0, *tail), dtype, maxshape=(None, *tail), chunks=(chunk_rows, *tail)
    )


LAYOUT = "rigctl-session"
LAYOUT_VERSION = 1
PART_END_KIND = "part_end"
"""Kind of the event in the last row of a finished part."""
SESSION_END_KIND = "session_end"
"""Kind of the event before it in the last part of a sitting; its data are ``outcome``, of
:class:`SessionOutcome`, and the numbers of ``committed`` and ``planned`` trials."""

SAMPLE_UNIT = "attribute `sample_unit`"
"""The unit of a reading depends on the source, so an attribute of the part holds it."""

PLACES = "one column for each place, layer by layer; attribute `wiring`: the reading at each"

SAMPLES, COUNTER, FLAGS, EDGES = (
    "/taxels/samples",
    "/taxels/counter",
    "/taxels/flags",
    "/taxels/edges",
)

COUNTER_ARRAY = ArrayLayout(
    COUNTER, "counters", "i8", "samples", "the board's own sample number, unwrapped"
)

TAXEL_ARRAYS = (
    ArrayLayout(SAMPLES, "samples", "u2", SAMPLE_UNIT, PLACES, per_taxel=True, raw=True),
    COUNTER_ARRAY,
    ArrayLayout(
        FLAGS, "flags", "u1", "", "bits of the taxel wire's flags; bit 0 is the sync level"
    ),
    ArrayLayout(EDGES, "edges", "u1", "", "sync rises mod 4 in bits 0–1, index marks mod 4 in 2–3"),
)

ARRIVALS = TableLayout(
    "/taxels/arrivals",
    "one row for each block of samples, as received",
    1024,
    (
        Column("first_row", "i8", "rows", "first row of the block in /taxels/samples"),
        Column("arrived_s", "f8", "s", "loop time at which the block's bytes arrived"),
    ),
    "first_row",
)

DRUM = TableLayout(
    "/drum",
    "one row for each poll of the drum",
    512,
    (
        Column("at_s", "f8", "s", "loop time of the reply"),
        Column("board_time_us", "i8", "µs", "the drum's clock at the reply, unwrapped"),
        Column("state", "u1", "", "state of the drum"),
        Column("fault", "u1", "", "first latched fault, 0 when none"),
        Column("fault_bits", "u4", "", "causes present at the poll"),
        Column("status_bits", "u2", "", "status bits of the drum wire"),
        Column("steps", "i8", "steps", "signed microsteps"),
        Column("angle_deg", "f4", "°", "drum angle from the steps"),
        Column("speed_mm_s", "f4", "mm/s", "surface speed commanded to the stepper"),
        Column("speed_set_mm_s", "f4", "mm/s", "speed set-point"),
        Column("force_g", "f4", "g", "newest load-cell reading after tare and scale"),
        Column("force_set_g", "f4", "g", "force set-point"),
        Column("actuator_position_um", "i4", "µm", "actuator travel from its upper end"),
        Column("actuator_drive_permille", "i2", "‰", "signed duty, positive presses"),
        Column("sync_count", "i8", "", "rises of the sync line"),
        Column("sync_rise_us", "i8", "µs", "board time of the last rise"),
        Column("sync_fall_us", "i8", "µs", "board time of the last fall"),
        Column("index_count", "i8", "", "index marks seen"),
        Column("loadcell_lost", "i4", "", "load-cell samples lost directly before this poll"),
        *(Column(entry.name, "f4", entry.unit, entry.doc, optional=True) for entry in STORED),
    ),
)

LOADCELL = TableLayout(
    "/loadcell",
    "one row for each conversion of the load cell",
    1024,
    (
        Column("sequence", "i8", "", "number of the conversion, unwrapped"),
        Column("board_time_us", "i8", "µs", "the drum's clock when it was ready, unwrapped"),
        Column("raw_counts", "i4", "counts", "reading of the amplifier"),
        Column("force_g", "f4", "g", "after tare and scale"),
    ),
    "board_time_us",
)

ATTEMPT = (
    Column("trial_id", "i4", "", "number in planned order, from 1"),
    Column("attempt", "i2", "", "1 for the first attempt"),
    Column("part", "i2", "", "part that holds the row and its samples"),
)
OUTCOME = (
    Column("verdict", "S12", "", "committed, rejected or aborted"),
    Column("reasons", "S192", "", "reasons of the verdict, joined by '; '"),
    Column("started_s", "f8", "s", "loop time at which the attempt began"),
    Column("ended_s", "f8", "s", "loop time at which it ended"),
)
"""First columns and outcome of a trial's row in every experiment."""

TRIALS = TableLayout(
    "/trials",
    "one row for each attempt at a trial, written at its end",
    32,
    (
        *ATTEMPT,
        Column("texture", "S16", "", "name of the plate"),
        Column("speed_mm_s", "f8", "mm/s", "planned speed"),
        Column("force_g", "f8", "g", "planned force; 0 in force mode position"),
        Column("repeat", "i4", "", "repeat of this condition, from 1; anew with each of `mounts`"),
        Column("travel_mm", "f8", "mm", "texture travel of the recorded window"),
        Column("force_mode", "S12", "", "hold, lock or position"),
        Column("direction", "S12", "", "forward or backward"),
        Column("depth_mm", "f8", "mm", "planned depth below contact, force mode position"),
        Column("first_counter", "i8", "samples", "counter of the first sample; -1: no window"),
        Column("first_sample", "i8", "rows", "its row in /taxels/samples; -1: no window"),
        Column("count", "i8", "samples", "length of the window, counted from first_counter"),
        *OUTCOME,
        Column("mean_speed_mm_s", "f8", "mm/s", "over the window, from the polls"),
        Column("mean_force_g", "f8", "g", "over the window, from the load cell"),
        Column("mount", "i4", "", "mounting of this plate, from 1"),
    ),
)

EVENTS = TableLayout(
    "/events",
    "events, for people and programs",
    64,
    (
        Column("at_s", "f8", "s", "loop time"),
        Column("kind", "S16", "", "short lower-case word"),
        Column("text", "S192", "", "one sentence"),
        Column("data", "S320", "", "details as a JSON object"),
    ),
)

GAPS = TableLayout(
    "/gaps",
    "samples that the board took and that are not in this file",
    64,
    (
        Column("first_counter", "i8", "samples", "counter of the first lost sample"),
        Column("count", "i8", "samples", "number of lost samples"),
        Column("row", "i8", "rows", "row of /taxels/samples before which they are missing"),
        Column("reason", "S32", "", "place of the loss"),
    ),
    "row",
)

TABLES = (ARRIVALS, DRUM, LOADCELL, TRIALS, EVENTS, GAPS)
DRUM_TRUTH = (
    ArrayLayout("/speed_mm_s", "speed_mm_s", "f4", "mm/s", "true speed, mean over the millisecond"),
    ArrayLayout("/force_g", "force_g", "f4", "g", "true force at the end of the millisecond"),
    ArrayLayout("/sync", "sync", "u1", "", "level of the sync line at the end of the millisecond"),
)
DRUM_LAYOUT = SessionLayout(
    DRUM_EXPERIMENT,
    "taxel board",
    TAXEL_ARRAYS,
    TABLES,
    TRIALS,
    (SAMPLES, COUNTER),
    truth=DRUM_TRUTH,
)


class SessionOutcome(StrEnum):
    """How a sitting of a session ended; after a crash or a kill there is no such event."""

    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"


PROTOCOL_FILE = "protocol.toml"
RIG_FILE = "rig.toml"
PART_PATTERN = "part-*.h5"
"""Matches every part, and copies such as ``part-0002 (copy).h5``, which are none."""
MAX_PARTS = 32_767
"""``part`` in /trials is a 16-bit number."""
_PART_NAME = re.compile(r"part-([0-9]{4,5})\.h5")


def part_name(number: int) -> str:
    """Return the file name of part ``number``, counted from 1."""
    return f"part-{number:04d}.h5"


def begun_path(part: Path) -> Path:
    """Return the file that is there while a part is being made; it never held a row."""
    return part.with_suffix(".new")


def part_number(path: Path) -> int:
    """Return the number in a part's file name; 0 for any other file."""
    found = _PART_NAME.fullmatch(path.name)
    number = int(found[1]) if found else 0
    return number if number <= MAX_PARTS and path.name == part_name(number) else 0


REASON_SEPARATOR = "; "
_DRUM = [column.name for column in DRUM.columns]
_SPEED_SET, _FORCE_SET = _DRUM.index("speed_set_mm_s"), _DRUM.index("force_set_g")
_REGISTERS = [entry.name for entry in STORED]
_drum_values = attrgetter(
    *(name for name in _DRUM if "_set_" not in name and name not in _REGISTERS)
)
_PLANNED = tuple(field.name for field in fields(PlannedTrial))
_trial_values = attrgetter(
    *(f"trial.{name}" if name in _PLANNED else name for name in TRIALS.dtype.names or ())
)

Row = tuple[Any, ...]


def clip_text(text: str, width: int) -> bytes:
    """Return UTF-8 of at most ``width`` bytes; a cut text ends in ``…``, never in half a letter."""
    data = text.encode()
    if len(data) <= width:
        return data
    return data[: width - 3].decode(errors="ignore").encode() + "…".encode()


def drum_row(state: DrumState, force_set_g: float, speed_set_mm_s: float) -> Row:
    """Return one row of /drum."""
    values = list(_drum_values(state))
    values.insert(_SPEED_SET, speed_set_mm_s)
    values.insert(_FORCE_SET, force_set_g)
    return (*values, *(state.values.get(name, nan) for name in _REGISTERS))


def event_row(event: Event) -> Row:
    """Return one row of /events; a note replaces ``data`` that does not fit."""
    data = json.dumps(event.data, ensure_ascii=False, default=str)
    if len(data.encode()) > EVENTS.columns[-1].text_bytes:
        data = json.dumps({"truncated": True, "length": len(data)})
    return encode_row((event.at_s, event.kind, event.text, data), EVENTS)


def parse_event(row: Any, path: Path) -> Event:
    """Return the event in a row of /events of the part at ``path``.

    Raises SessionError that names part and place if the row's data are no JSON object.
    """
    at_s = float(row["at_s"])
    data = parse_json(str(row["data"]), dict, path, f"the event at {at_s:g} s in /events")
    return Event(at_s, str(row["kind"]), str(row["text"]), data)


def trial_row(row: TrialRow, part: int, first_sample: int) -> Row:
    """Return one row of /trials; the writer supplies ``part`` and ``first_sample``."""
    stored = replace(row, part=part, first_sample=first_sample)
    return encode_row(_trial_values(stored), TRIALS)


def parse_trial(row: Any) -> TrialRow:
    """Return the attempt in a row of /trials, text as Unicode."""
    values: dict[str, Any] = dict(zip(row.dtype.names, row.item(), strict=True))
    trial = PlannedTrial(**{name: values.pop(name) for name in _PLANNED})
    return TrialRow(trial=trial, **parse_verdict(values))


def parse_verdict(values: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of an attempt with its verdict and reasons as values."""
    reasons = values["reasons"]
    parsed = tuple(reasons.split(REASON_SEPARATOR)) if reasons else ()
    return {**values, "verdict": Verdict(values["verdict"]), "reasons": parsed}


def encode_row(values: Iterable[Any], table: TableLayout) -> Row:
    """Return values as a row of a table; text is cut to its column's length."""
    return tuple(map(_encode, values, table.columns))


def _encode(value: Any, column: Column) -> Any:
    if not column.text_bytes:
        return value
    text = REASON_SEPARATOR.join(value) if isinstance(value, tuple) else value
    return clip_text(text, column.text_bytes)
