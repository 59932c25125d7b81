"""One part for reading: a finished file, one that a killed writer left, or one that still grows."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.format import layout
from rigctl.session.format.header import SessionHeader
from rigctl.session.read.folder import attributes, open_part, part_number

LIVE_SLICE_ROWS = 5_000
"""Larger reads of a growing file would hold a writer in the same process up for long."""

Structured = NDArray[np.void]


class PartReader:
    """Rows of one part as they stood at the last :meth:`refresh`.

    Raises SessionError for a file that is damaged or of another layout version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = part_number(path)
        self._file = open_part(path)
        self.attributes = attributes(self._file)
        try:
            self.header = SessionHeader.from_attributes(self.attributes)
            self._arrays = {a.path: self._file[a.path] for a in layout.TAXEL_ARRAYS}
            self._tables = {t.path: self._file[t.path] for t in layout.TABLES}
        except KeyError as error:
            self._file.close()
            raise SessionError(f"{path} is damaged, it lacks {error}") from error
        self._dtypes = {t.path: _readable(t) for t in layout.TABLES}
        self._grows = bool(self._file.id.get_intent() & h5py.h5f.ACC_SWMR_READ)
        self.finished = False
        self.n_samples = 0
        self.refresh()

    def refresh(self) -> None:
        """See what was flushed since. Trials first: their samples were flushed before them."""
        if self.finished:
            return
        if self._grows:
            self._tables[layout.TRIALS.path].refresh()
            for dataset in (*self._tables.values(), *self._arrays.values()):
                dataset.refresh()
        self.n_samples = min(int(dataset.shape[0]) for dataset in self._arrays.values())
        self.finished = self._ended()

    @property
    def grows(self) -> bool:
        """Whether a living writer may append to it."""
        return self._grows

    def array(self, path: str) -> Any:
        """One of the per-sample data sets as h5py has it."""
        return self._arrays[path]

    def n_rows(self, table: layout.TableLayout) -> int:
        """Rows of a table."""
        return int(self._tables[table.path].shape[0])

    def lengths(self) -> dict[str, int]:
        """Rows of each per-sample data set; they differ by the last flush of a killed writer."""
        return {path: int(dataset.shape[0]) for path, dataset in self._arrays.items()}

    def rows(
        self, table: layout.TableLayout, start: int = 0, stop: int | None = None
    ) -> Structured:
        """Rows of a table; text as Unicode."""
        with self.named():
            raw = self._tables[table.path][start:stop]
        return self._readable_rows(table, raw)

    def rows_with(self, table: layout.TableLayout, column: str, text: str) -> Structured:
        """Rows of a table with a text in one of its columns: the others are not decoded."""
        with self.named():
            raw = self._tables[table.path][:]
        return self._readable_rows(table, raw[raw[column] == text.encode()])

    def _readable_rows(self, table: layout.TableLayout, raw: Structured) -> Structured:
        dtype = self._dtypes[table.path]
        rows: Structured = np.empty(raw.shape, dtype)
        for column in table.columns:
            text = column.kind.startswith("S")
            rows[column.name] = _decoded(raw[column.name]) if text else raw[column.name]
        return rows

    def read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Rows [start, stop) of one of the per-sample data sets, in slices while it grows."""
        dataset = self._arrays[path]
        stop = min(stop, self.n_samples)
        with self.named():
            if not self._grows:
                whole: NDArray[Any] = dataset[start:stop]
                return whole
            out = np.empty((max(0, stop - start), *dataset.shape[1:]), dataset.dtype)
            for first in range(start, stop, LIVE_SLICE_ROWS):
                last = min(stop, first + LIVE_SLICE_ROWS)
                out[first - start : last - start] = dataset[first:last]
            return out

    def first_at(self, table: layout.TableLayout, column: str, value: float) -> int:
        """First row of an ascending column that is not below ``value``, without reading it all."""
        dataset = self._tables[table.path]
        with self.named():
            places = range(int(dataset.shape[0]))
            return bisect_left(places, value, key=lambda row: dataset[row][column])

    def column_sum(self, table: layout.TableLayout, column: str) -> int:
        """Sum of one integer column of a table."""
        with self.named():
            return int(self._tables[table.path].fields(column)[:].sum(dtype=np.int64))

    def text(self, path: str) -> str:
        """One of the texts that came with the part."""
        return str(self._file[path][()].decode())

    def documentation(self) -> dict[str, dict[str, Any]]:
        """Attributes of each data set."""
        nodes = {**self._arrays, **self._tables}
        return {path: attributes(node) for path, node in nodes.items()}

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _ended(self) -> bool:
        events = self._tables[layout.EVENTS.path]
        with self.named():
            return bool(events.shape[0]) and events[-1]["kind"] == layout.END_KIND.encode()

    @contextmanager
    def named(self) -> Iterator[None]:
        """What HDF5 cannot read is a fault of this file."""
        try:
            yield
        except OSError as error:
            raise SessionError(f"{self.path} is damaged: {error}") from error


def _decoded(column: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """UTF-8 to Unicode; the few different texts of a long column are decoded once each."""
    unique, inverse = np.unique(column, return_inverse=True)
    decoded = np.array([text.decode(errors="replace") for text in unique], dtype=np.str_)
    texts: NDArray[np.str_] = decoded[inverse] if len(decoded) else decoded.astype("U1")
    return texts


def _readable(table: layout.TableLayout) -> np.dtype[Any]:
    """The stored row type with Unicode in place of UTF-8."""
    kinds = [c.kind.replace("S", "U") if c.kind.startswith("S") else c.kind for c in table.columns]
    return np.dtype([(c.name, kind) for c, kind in zip(table.columns, kinds, strict=True)])
