"""HDF5 layout of a session's part: every data set and column with its type, unit and meaning.

``docs/reference/session.md`` shows the same tables. All data sets are created before the first
sample, because HDF5 cannot add any to a file in SWMR mode; strings have a fixed length for the
same reason. ``('v110', 'v110')`` is the newest format that the HDF5 1.10 tools of today's
distributions read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.session.format.annotated_arrays import Attributes, text_scalar, write_attributes

LAYOUT = "rigctl-session"
LAYOUT_VERSION = 1
LIBVER = ("v110", "v110")
PROTOCOL_FILE = "protocol.toml"
RIG_FILE = "rig.toml"
LOCK_FILE = "writer.lock"
PART_PATTERN = "part-*.h5"
PART_END_KIND = "part_end"
"""Kind of the event in the last row of a finished part."""

SAMPLE_CHUNK_ROWS = 4096
"""A chunk of samples is 147 kB at 18 taxels: small to rewrite at each flush, large to read."""


@dataclass(frozen=True, slots=True)
class Column:
    """A named value of a row: NumPy type code (``S`` is UTF-8 text), unit, meaning."""

    name: str
    type_code: str
    unit: str
    doc: str

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
    """A growing one-dimensional data set whose rows are HDF5 compounds."""

    path: str
    doc: str
    chunk_rows: int
    columns: tuple[Column, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Row type in the file."""
        return np.dtype([(c.name, c.stored_dtype) for c in self.columns])


@dataclass(frozen=True, slots=True)
class ArrayLayout:
    """A growing data set of plain numbers, one row for each taxel sample."""

    path: str
    type_code: str
    unit: str
    doc: str
    per_taxel: bool = False


SAMPLE_UNIT = "attribute `sample_unit`"
"""The unit of a reading depends on the source, so an attribute of the part holds it."""

PLACES = "one column for each place, layer by layer; attribute `wiring`: the reading at each"

TAXEL_ARRAYS = (
    ArrayLayout("/taxels/samples", "u2", SAMPLE_UNIT, PLACES, True),
    ArrayLayout("/taxels/counter", "i8", "samples", "the board's own sample number, unwrapped"),
    ArrayLayout(
        "/taxels/flags", "u1", "", "bits of the taxel wire's flags; bit 0 is the sync level"
    ),
    ArrayLayout(
        "/taxels/edges", "u1", "", "sync rises mod 4 in bits 0–1, index marks mod 4 in 2–3"
    ),
)

ARRIVALS = TableLayout(
    "/taxels/arrivals",
    "one row for each block of samples, as received",
    1024,
    (
        Column("first_row", "i8", "rows", "first row of the block in /taxels/samples"),
        Column("arrived_s", "f8", "s", "loop time at which the block's bytes arrived"),
    ),
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
    "one row for each conversion of the load cell",
    1024,
    (
        Column("sequence", "i8", "", "number of the conversion, unwrapped"),
        Column("board_time_us", "i8", "µs", "the drum's clock when it was ready, unwrapped"),
        Column("raw_counts", "i4", "counts", "reading of the amplifier"),
        Column("force_g", "f4", "g", "after tare and scale"),
    ),
)

TRIALS = TableLayout(
    "/trials",
    "one row for each attempt at a trial, written at its end",
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
        Column("reasons", "S192", "", "reasons of the verdict, joined by '; '"),
        Column("started_s", "f8", "s", "loop time at which the attempt began"),
        Column("ended_s", "f8", "s", "loop time at which it ended"),
        Column("mean_speed_mm_s", "f8", "mm/s", "over the window, from the polls"),
        Column("mean_force_g", "f8", "g", "over the window, from the load cell"),
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
)

TABLES = (ARRIVALS, DRUM, LOADCELL, TRIALS, EVENTS, GAPS)
TEXTS = (("/protocol_toml", "text of the protocol"), ("/rig_toml", "text of rig.toml"))


def part_name(number: int) -> str:
    """Return the file name of part ``number``, counted from 1."""
    return f"part-{number:04d}.h5"


def part_number(path: Path) -> int:
    """Return the number in a part's file name; 0 for any other file."""
    digits = path.stem.removeprefix("part-")
    return int(digits) if digits.isdigit() else 0


def build_empty_part(attributes: Attributes, n_taxels: int, texts: tuple[str, str]) -> bytes:
    """Return a part with every data set empty. ``texts``: protocol and rig description."""
    with h5py.File("new", "w", driver="core", backing_store=False, libver=LIBVER) as file:
        write_attributes(file, attributes)
        for array in TAXEL_ARRAYS:
            _create_array(file, array, n_taxels, str(attributes.get("sample_unit", "")))
        for table in TABLES:
            _create_table(file, table)
        for (path, doc), text in zip(TEXTS, texts, strict=True):
            write_attributes(file.create_dataset(path, data=text_scalar(text)), {"doc": doc})
        file.flush()
        return bytes(file.id.get_file_image())


def _create_array(file: Any, array: ArrayLayout, n_taxels: int, sample_unit: str) -> None:
    tail = (n_taxels,) if array.per_taxel else ()
    dataset = _create(file, array.path, f"<{array.type_code}", SAMPLE_CHUNK_ROWS, tail)
    shape = "(sample, taxel)" if array.per_taxel else "(sample,)"
    unit = sample_unit if array.per_taxel and sample_unit else array.unit or "none"
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
