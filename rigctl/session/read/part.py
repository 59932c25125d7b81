"""Read one part through HDF5: closed, unclosed by a killed writer, or still growing.

Tables, texts and single trials come through here, and so do all samples that
:mod:`rigctl.session.read.sample_index` cannot read from the file directly: those of a growing
part and of one with compressed chunks.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format import file_names, layout
from rigctl.session.format.data_sets import DIGESTS, TableLayout
from rigctl.session.format.experiments import layout_of
from rigctl.session.format.metadata.header import SessionHeader
from rigctl.session.hdf5_file import Hdf5File
from rigctl.session.read.part_file import describe_file, open_part, readable_rows
from rigctl.session.read.part_schema import part_schema

LIVE_SLICE_ROWS = 5_000
"""Larger reads of a growing file would delay a writer in the same process for long."""

StructuredArray = NDArray[np.void]


class PartReader:
    """Rows of one part as of the last :meth:`refresh`.

    ``cut_rows``: how many rows of each data set are beyond the end of a killed part that was also
    cut short; they do not count.

    Raises SessionError for a damaged file or another layout version.
    """

    def __init__(self, path: Path, open_file: Callable[[Path], Hdf5File] = open_part) -> None:
        self.path = path
        self._open_file = open_file
        self.number = file_names.part_number(path)
        self._open()

    def refresh(self) -> None:
        """Update to the last flush by opening the file again.

        ``Dataset.refresh`` is not safe: where this process has opened the file twice, HDF5 2.0.0
        then returns rows of other chunks.
        """
        if not self.finished:
            self.close()
            self._open()

    def _open(self) -> None:
        self._file = self._open_file(self.path)
        try:
            self._check()
        except SessionError:
            self._file.close()
            raise

    def _check(self) -> None:
        """Check the description and every data set before any data is read."""
        self.attributes = self._file.attributes()
        self.layout = layout_of(self.attributes, self.path)
        self.header = SessionHeader.from_attributes(self.attributes, self.path)
        self._file.check(part_schema(self.layout, self.header.n_taxels))
        self._n_rows, self.cut_rows = self._count_rows()
        self.n_samples = min(self.lengths().values())
        self.finished = self._ends_with(layout.PART_END_KIND)

    def _count_rows(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return the rows of each data set that the file holds, and how many it lacks."""
        names = [array.path for array in self.layout.arrays]
        names += [table.path for table in (*self.layout.tables, DIGESTS)]
        paths = [path for path in names if self._file.is_checked(path)]
        lengths = {path: self._file.shape(path)[0] for path in paths}
        if not self._file.is_cut:
            return lengths, {}
        held = {path: self._readable_rows(path) for path in paths}
        return held, {path: lengths[path] - n for path, n in held.items() if n < lengths[path]}

    def _readable_rows(self, path: str) -> int:
        """Return the rows of a data set that the file holds; none if it lacks their places."""
        try:
            return readable_rows(self._file, path)
        except SessionError:
            return 0

    def describe_cut(self) -> list[str]:
        """Return a sentence for each data set that was cut short."""
        return [
            f"{self.path.name} was cut short, the file ends before the last {n} rows of {path}"
            for path, n in self.cut_rows.items()
        ]

    def _ends_with(self, kind: str) -> bool:
        """Return whether the last event is of this kind."""
        path, n_rows = layout.EVENTS.path, self.n_rows(layout.EVENTS)
        return bool(n_rows and self._file.row(path, n_rows - 1)["kind"] == kind.encode())

    @property
    def has_digests(self) -> bool:
        """Whether the part has digests of its rows; parts from before 2026-11-23 lack them."""
        return self._file.is_checked(DIGESTS.path)

    @property
    def is_growing(self) -> bool:
        """Whether a living writer may append to it."""
        return self._file.is_growing

    @property
    def file(self) -> Hdf5File:
        """The open file, its data sets checked; rows are as stored."""
        return self._file

    def n_rows(self, table: TableLayout) -> int:
        """Return the number of rows of a table."""
        return self._n_rows.get(table.path, 0)

    def lengths(self) -> dict[str, int]:
        """Return the rows of each per-sample data set; after a kill they differ by one flush."""
        return {array.path: self._n_rows[array.path] for array in self.layout.arrays}

    def stored_lengths(self) -> dict[str, int]:
        """Return the rows of each data set that grows, by its path."""
        tables = (*self.layout.tables, DIGESTS)
        return {**self.lengths(), **{t.path: self.n_rows(t) for t in tables}}

    def stored_rows(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of an array or table as stored, text as bytes."""
        return self._file.rows(path, start, stop)

    def describe(self) -> bytes:
        """Return what the part holds besides its rows, as its first digest covers it."""
        return describe_file(self._file)

    def rows(self, table: TableLayout, start: int = 0, stop: int | None = None) -> StructuredArray:
        """Return rows of a table; text as Unicode. A table that older parts lack is empty."""
        if not self._file.is_checked(table.path):
            return self._decode_rows(table, np.empty(0, table.dtype))
        n_rows = self.n_rows(table)
        stop = n_rows if stop is None else min(stop, n_rows)
        return self._decode_rows(table, self._file.rows(table.path, start, stop))

    def rows_where(self, table: TableLayout, column: str, text: str) -> StructuredArray:
        """Return the rows with ``text`` in a column; only these are decoded."""
        raw = self._file.rows(table.path, 0, self.n_rows(table))
        return self._decode_rows(table, raw[raw[column] == text.encode()])

    def read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of a per-sample data set, read in slices while it grows."""
        stop = min(stop, self.n_samples)
        if not self.is_growing:
            return self._file.rows(path, start, stop)
        tail = self._file.shape(path)[1:]
        out = np.empty((max(0, stop - start), *tail), self._file.dtype(path))
        for first in range(start, stop, LIVE_SLICE_ROWS):
            last = min(stop, first + LIVE_SLICE_ROWS)
            out[first - start : last - start] = self._file.rows(path, first, last)
        return out

    def rows_between(
        self, table: TableLayout, column: str, first: float, last: float
    ) -> StructuredArray:
        """Return the rows with ``first`` ≤ ``column`` ≤ ``last``, an ascending column."""
        path, rows = table.path, range(self.n_rows(table))
        start = bisect_left(rows, first, key=lambda row: self._file.row(path, row)[column])
        stop = bisect_right(rows, last, key=lambda row: self._file.row(path, row)[column])
        return self.rows(table, start, stop)

    def text(self, path: str) -> str:
        """Return the protocol or the rig's description."""
        return self._file.text(path)

    def dataset_attributes(self) -> dict[str, dict[str, Any]]:
        """Return the attributes of each data set by its path."""
        paths = [a.path for a in self.layout.arrays] + [t.path for t in self.layout.tables]
        return {p: self._file.attributes(p) for p in paths if self._file.is_checked(p)}

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _decode_rows(self, table: TableLayout, raw: StructuredArray) -> StructuredArray:
        dtype = [(c.name, c.type_code.replace("S", "U")) for c in table.columns]
        raw = table.complete(raw)
        rows: StructuredArray = np.empty(raw.shape, dtype)
        for column in table.columns:
            values = raw[column.name]
            rows[column.name] = _decode_texts(values) if column.text_bytes else values
        return rows


def _decode_texts(column: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """Return UTF-8 as Unicode; decode each of a long column's few different texts once."""
    unique, inverse = np.unique(column, return_inverse=True)
    decoded = np.array([text.decode(errors="replace") for text in unique], dtype=np.str_)
    texts: NDArray[np.str_] = decoded[inverse] if len(decoded) else decoded.astype("U1")
    return texts
