"""Describe the data sets of a part as values, and build an empty part from them.

All data sets are created before the first sample, because HDF5 cannot add any to a file in SWMR
mode; strings have a fixed length for the same reason. ``('v110', 'v110')`` is the newest format
that the HDF5 1.10 tools of today's distributions read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from uuid import uuid4

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.session.hdf5_file import Attributes, text_scalar, write_attributes

LIBVER = ("v110", "v110")
SAMPLE_CHUNK_ROWS = 4096
"""A chunk of samples is 147 kB at 18 taxels: small to rewrite at each flush, large to read."""

TEXTS = (("/protocol_toml", "text of the protocol"), ("/rig_toml", "text of rig.toml"))


@dataclass(frozen=True, slots=True)
class Column:
    """A named value of a row: NumPy type code (``S`` is UTF-8 text), unit, meaning.

    ``before``: the value in parts that are older than the column, None if every part has it.
    ``older_code``: the type code in older parts, empty where it never changed.
    """

    name: str
    type_code: str
    unit: str
    doc: str
    before: int | None = None
    older_code: str = ""

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

    @property
    def older_dtype(self) -> np.dtype[Any] | None:
        """Row type in older parts, None where it never changed."""
        first = [column for column in self.columns if column.before is None]
        older = [replace(c, type_code=c.older_code) if c.older_code else c for c in first]
        dtype = np.dtype([(c.name, c.stored_dtype) for c in older])
        return None if dtype == self.dtype else dtype

    def complete(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return rows as stored with all columns, also those that an older part lacks."""
        names = rows.dtype.names or ()
        if rows.dtype == self.dtype:
            return rows
        complete = np.empty(rows.shape, self.dtype)
        for column in self.columns:
            present = column.name in names
            complete[column.name] = rows[column.name] if present else column.before
        return complete


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
"""In every part, whatever its layout; parts from before 2026-11-23 lack it."""


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
    for people. ``trials`` is the one of ``tables`` that is written last.
    """

    experiment: str
    board: str
    arrays: tuple[ArrayLayout, ...]
    tables: tuple[TableLayout, ...]
    trials: TableLayout


def build_empty_part(
    layout: SessionLayout, attributes: Attributes, n_taxels: int, texts: tuple[str, str]
) -> bytes:
    """Return a part with every data set empty. ``texts``: protocol and rig description."""
    # HDF5 knows files in memory by name, and two threads may each build one.
    name = f"new {uuid4()}"
    with h5py.File(name, "w", driver="core", backing_store=False, libver=LIBVER) as file:
        write_attributes(file, attributes)
        for array in layout.arrays:
            _create_array(file, array, n_taxels, str(attributes.get("sample_unit", "")))
        for table in (*layout.tables, DIGESTS):
            _create_table(file, table)
        for (path, doc), text in zip(TEXTS, texts, strict=True):
            write_attributes(file.create_dataset(path, data=text_scalar(text)), {"doc": doc})
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
