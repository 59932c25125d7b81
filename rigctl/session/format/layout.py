"""What stands where in a part of a session: the one table of groups, columns, units, meanings.

``docs/reference/session.md`` shows the same table. A part is created whole, before its first
sample, because nothing can be added to a file once it is written in SWMR mode; strings are of
fixed length for the same reason. ``('v110', 'v110')`` is the newest format that the HDF5 1.10
tools of today's distributions read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

LAYOUT = "rigctl-session"
LAYOUT_VERSION = 1
LIBVER = ("v110", "v110")
PROTOCOL_FILE = "protocol.toml"
RIG_FILE = "rig.toml"
LOCK_FILE = "writer.lock"
PART_PATTERN = "part-*.h5"
END_KIND = "part_end"
"""Kind of the event that is a finished part's last row."""

SAMPLE_CHUNK_ROWS = 4096
"""One chunk of samples is 147 kB at 18 taxels: small to rewrite at each flush, large to read."""


@dataclass(frozen=True, slots=True)
class Column:
    """One named value of a row: NumPy type (``S`` is UTF-8 text), unit, meaning."""

    name: str
    kind: str
    unit: str
    doc: str


@dataclass(frozen=True, slots=True)
class TableLayout:
    """A growing one-dimensional data set whose rows are HDF5 compounds."""

    path: str
    doc: str
    chunk_rows: int
    columns: tuple[Column, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """The row's type as stored: text is fixed-length UTF-8."""
        return np.dtype([(c.name, _stored(c.kind)) for c in self.columns])


@dataclass(frozen=True, slots=True)
class Array:
    """A growing data set of plain numbers, one row a taxel sample."""

    path: str
    kind: str
    unit: str
    doc: str
    per_taxel: bool = False


def _stored(kind: str) -> np.dtype[Any]:
    if not kind.startswith("S"):
        return np.dtype(f"<{kind}")
    dtype: np.dtype[Any] = h5py.string_dtype("utf-8", int(kind[1:]))
    return dtype


SAMPLE_UNIT = "attribute `sample_unit`"
"""What a reading is depends on who made it, so the part's own attribute says it."""

PLACES = "a column a place of the sensor, layer by layer; attribute `wiring`: the readings there"

TAXEL_ARRAYS = (
    Array("/taxels/samples", "u2", SAMPLE_UNIT, PLACES, True),
    Array("/taxels/counter", "i8", "samples", "the board's own sample number, unwrapped"),
    Array("/taxels/flags", "u1", "", "bits of the taxel wire's flags; bit 0 is the sync level"),
    Array("/taxels/edges", "u1", "", "sync rises mod 4 in bits 0–1, index marks mod 4 in 2–3"),
)

ARRIVALS = TableLayout(
    "/taxels/arrivals",
    "one row a block of samples as the host received it",
    1024,
    (
        Column("first_row", "i8", "rows", "first row of the block in /taxels/samples"),
        Column("arrived_s", "f8", "s", "loop time at which the block's bytes arrived"),
    ),
)

DRUM = TableLayout(
    "/drum",
    "one row a poll of the drum",
    512,
    (
        Column("at_s", "f8", "s", "loop time of the reply"),
        Column("board_time_us", "i8", "µs", "the drum's clock at the reply, unwrapped"),
        Column("state", "u1", "", "state of the drum"),
        Column("fault", "u1", "", "first latched fault, 0 when none"),
        Column("fault_bits", "u2", "", "causes present at the poll"),
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
    ),
)

LOADCELL = TableLayout(
    "/loadcell",
    "one row a conversion of the load cell, each exactly once",
    1024,
    (
        Column("sequence", "i8", "", "number of the conversion, unwrapped"),
        Column("board_time_us", "i8", "µs", "the drum's clock when it was ready, unwrapped"),
        Column("raw_counts", "i4", "counts", "what the amplifier said"),
        Column("force_g", "f4", "g", "after tare and scale"),
    ),
)

TRIALS = TableLayout(
    "/trials",
    "one row an attempt at a trial, written when it ended",
    32,
    (
        Column("trial_id", "i4", "", "number in planned order, from 1"),
        Column("attempt", "i2", "", "1 for the first attempt"),
        Column("part", "i2", "", "part that holds the row and its samples"),
        Column("texture", "S16", "", "name of the plate"),
        Column("speed_mm_s", "f8", "mm/s", "planned speed"),
        Column("force_g", "f8", "g", "planned force; 0 in force mode position"),
        Column("repeat", "i4", "", "repeat of this condition, from 1"),
        Column("travel_mm", "f8", "mm", "texture travel of the recorded window"),
        Column("force_mode", "S12", "", "hold, lock or position"),
        Column("direction", "S12", "", "forward or backward"),
        Column("depth_mm", "f8", "mm", "planned depth below contact, force mode position"),
        Column("first_counter", "i8", "samples", "counter of the first sample; -1: no window"),
        Column("first_sample", "i8", "rows", "its row in /taxels/samples; -1: no window"),
        Column("count", "i8", "samples", "length of the window, counted from first_counter"),
        Column("verdict", "S12", "", "committed, rejected or aborted"),
        Column("reasons", "S192", "", "why, joined by '; '"),
        Column("started_s", "f8", "s", "loop time at which the attempt began"),
        Column("ended_s", "f8", "s", "loop time at which it ended"),
        Column("mean_speed_mm_s", "f8", "mm/s", "over the window, from the polls"),
        Column("mean_force_g", "f8", "g", "over the window, from the load cell"),
    ),
)

EVENTS = TableLayout(
    "/events",
    "what happened, for people and for programs",
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
    "samples that the board took and this file does not hold",
    64,
    (
        Column("first_counter", "i8", "samples", "counter of the first lost sample"),
        Column("count", "i8", "samples", "how many were lost"),
        Column("row", "i8", "rows", "row of /taxels/samples before which they are missing"),
        Column("reason", "S32", "", "where they were lost"),
    ),
)

TABLES = (ARRIVALS, DRUM, LOADCELL, TRIALS, EVENTS, GAPS)
TEXTS = (("/protocol_toml", "the protocol as it was run"), ("/rig_toml", "the rig's description"))


def part_name(number: int) -> str:
    """File name of part ``number``, counted from 1."""
    return f"part-{number:04d}.h5"


def text_array(text: str, length: int | None = None) -> NDArray[np.bytes_]:
    """UTF-8 ``text`` as a zero-dimensional fixed-length string that HDF5 knows as UTF-8."""
    data = text.encode()
    return np.array(data, dtype=h5py.string_dtype("utf-8", max(1, length or len(data))))


def describe(node: Any, attributes: dict[str, str | int | float]) -> None:
    """Write attributes; text becomes fixed-length UTF-8."""
    for name, value in attributes.items():
        node.attrs.create(name, text_array(value) if isinstance(value, str) else value)


def image(attributes: dict[str, str | int | float], n_taxels: int, texts: tuple[str, str]) -> bytes:
    """An empty part, every data set in place. ``texts``: protocol and rig description."""
    with h5py.File("new", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        describe(file, attributes)
        for array in TAXEL_ARRAYS:
            _create_array(file, array, n_taxels, str(attributes.get("sample_unit", "")))
        for table in TABLES:
            _create_table(file, table)
        for (path, doc), text in zip(TEXTS, texts, strict=True):
            describe(file.create_dataset(path, data=text_array(text)), {"doc": doc})
        file.flush()
        return bytes(file.id.get_file_image())


def _create_array(file: Any, array: Array, n_taxels: int, sample_unit: str) -> None:
    tail = (n_taxels,) if array.per_taxel else ()
    dataset = file.create_dataset(
        array.path,
        shape=(0, *tail),
        maxshape=(None, *tail),
        chunks=(SAMPLE_CHUNK_ROWS, *tail),
        dtype=f"<{array.kind}",
    )
    shape = "(sample, taxel)" if array.per_taxel else "(sample,)"
    unit = sample_unit if array.per_taxel and sample_unit else array.unit or "none"
    describe(dataset, {"doc": array.doc, "unit": unit, "shape": shape})


def _create_table(file: Any, table: TableLayout) -> None:
    dataset = file.create_dataset(
        table.path, shape=(0,), maxshape=(None,), chunks=(table.chunk_rows,), dtype=table.dtype
    )
    describe(dataset, {"doc": table.doc, "shape": "(row,)"})
    lines = [f"{c.name} [{c.unit or 'none'}]: {c.doc}".encode() for c in table.columns]
    width = max(map(len, lines))
    dataset.attrs.create("columns", np.array(lines, dtype=h5py.string_dtype("utf-8", width)))
