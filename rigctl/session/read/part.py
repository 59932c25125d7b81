"""Read one part through HDF5: closed, unclosed by a killed writer, or still growing.

Tables, texts and single trials come through here, and so do all samples that
:mod:`rigctl.session.read.sample_index` cannot read from the file directly: those of a growing
part and of one with compressed chunks.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.annotated_arrays import read_attributes, read_text
from rigctl.session.format.data_sets import DIGESTS, TableLayout
from rigctl.session.format.experiments import layout_of
from rigctl.session.format.header import SessionHeader
from rigctl.session.read.part_file import open_part

LIVE_SLICE_ROWS = 5_000
"""Larger reads of a growing file would delay a writer in the same process for long."""

StructuredArray = NDArray[np.void]


class PartReader:
    """Rows of one part as of the last :meth:`refresh`.

    Raises SessionError for a damaged file or another layout version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = layout.part_number(path)
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
        """Open the file, trials before samples: the writer flushes samples before their trial."""
        self._file = open_part(self.path)
        self.attributes = read_attributes(self._file)
        try:
            self.layout = layout_of(self.attributes, self.path)
            self.header = SessionHeader.from_attributes(self.attributes)
            self._tables = {t.path: self._file[t.path] for t in self.layout.tables}
            self._arrays = {a.path: self._file[a.path] for a in self.layout.arrays}
            if DIGESTS.path in self._file:
                self._tables[DIGESTS.path] = self._file[DIGESTS.path]
        except KeyError as error:
            self._file.close()
            raise SessionError(f"{self.path} is damaged, it lacks {error}") from error
        self.n_samples = min(self.lengths().values())
        events = self._tables[layout.EVENTS.path]
        with self.translate_errors():
            end = layout.PART_END_KIND.encode()
            self.finished = bool(events.shape[0]) and events[-1]["kind"] == end

    @property
    def has_digests(self) -> bool:
        """Whether the part has digests of its rows; parts from before 2026-11-23 lack them."""
        return DIGESTS.path in self._tables

    @property
    def is_growing(self) -> bool:
        """Whether a living writer may append to it."""
        return bool(self._file.id.get_intent() & h5py.h5f.ACC_SWMR_READ)

    def dataset(self, path: str) -> Any:
        """Return the h5py data set of a per-sample array."""
        return self._arrays[path]

    def n_rows(self, table: TableLayout) -> int:
        """Return the number of rows of a table."""
        return int(self._tables[table.path].shape[0])

    def lengths(self) -> dict[str, int]:
        """Return the rows of each per-sample data set; after a kill they differ by one flush."""
        return {path: int(dataset.shape[0]) for path, dataset in self._arrays.items()}

    def rows(self, table: TableLayout, start: int = 0, stop: int | None = None) -> StructuredArray:
        """Return rows of a table; text as Unicode."""
        with self.translate_errors():
            raw = self._tables[table.path][start:stop]
        return self._decode_rows(table, raw)

    def rows_where(self, table: TableLayout, column: str, text: str) -> StructuredArray:
        """Return the rows with ``text`` in a column; only these are decoded."""
        with self.translate_errors():
            raw = self._tables[table.path][:]
        return self._decode_rows(table, raw[raw[column] == text.encode()])

    def read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of a per-sample data set, read in slices while it grows."""
        dataset = self._arrays[path]
        stop = min(stop, self.n_samples)
        with self.translate_errors():
            if not self.is_growing:
                rows: NDArray[Any] = dataset[start:stop]
                return rows
            out = np.empty((max(0, stop - start), *dataset.shape[1:]), dataset.dtype)
            for first in range(start, stop, LIVE_SLICE_ROWS):
                last = min(stop, first + LIVE_SLICE_ROWS)
                out[first - start : last - start] = dataset[first:last]
            return out

    def rows_between(
        self, table: TableLayout, column: str, first: float, last: float
    ) -> StructuredArray:
        """Return the rows with ``first`` ≤ ``column`` ≤ ``last``, an ascending column."""
        dataset, rows = self._tables[table.path], range(self.n_rows(table))
        with self.translate_errors():
            start = bisect_left(rows, first, key=lambda row: dataset[row][column])
            stop = bisect_right(rows, last, key=lambda row: dataset[row][column])
        return self.rows(table, start, stop)

    def text(self, path: str) -> str:
        """Return the protocol or the rig's description."""
        return read_text(self._file, path)

    def dataset_attributes(self) -> dict[str, dict[str, Any]]:
        """Return the attributes of each data set by its path."""
        return {path: read_attributes(d) for path, d in {**self._arrays, **self._tables}.items()}

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @contextmanager
    def translate_errors(self) -> Iterator[None]:
        """Raise SessionError that names this file for what HDF5 cannot read."""
        try:
            yield
        except OSError as error:
            raise SessionError(f"{self.path} is damaged: {error}") from error

    def _decode_rows(self, table: TableLayout, raw: StructuredArray) -> StructuredArray:
        dtype = [(c.name, c.type_code.replace("S", "U")) for c in table.columns]
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
