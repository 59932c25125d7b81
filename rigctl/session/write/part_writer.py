"""Write one part: append rows, flush and sync them, never rewrite any."""

from __future__ import annotations

import errno
import os
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.session.format.annotated_arrays import Attributes
from rigctl.session.format.data_sets import LIBVER, SessionLayout, TableLayout, build_empty_part
from rigctl.session.format.layout import ARRIVALS, GAPS
from rigctl.session.format.table_rows import Row
from rigctl.values import Gap

CHUNK_CACHE_BYTES = 1 << 20
"""For each data set: rows are appended and never read again, so the default of HDF5 2.0, 8 MiB,
would only fill up for the first hour of a recording."""


class SampleBlock(Protocol):
    """Samples that arrived together, with an attribute for each array of the layout."""

    @property
    def counters(self) -> NDArray[np.int64]:
        """The board's own sample number, int64 (n,), ascending."""

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """Losses found directly before or inside the block."""

    @property
    def arrived_s(self) -> float:
        """Loop time at which the bytes arrived."""

    def __len__(self) -> int: ...


class CounterMap:
    """Map from board counters to rows of a part: one entry for each run without a gap."""

    def __init__(self) -> None:
        self._counters: list[int] = []
        self._rows: list[int] = []
        self.next_row = 0
        self.next_counter: int | None = None

    def add(self, block: SampleBlock) -> None:
        """Add the rows of ``block``; its counters must ascend."""
        counters = block.counters
        before = counters[0] - 2 if self.next_counter is None else self.next_counter - 1
        starts = np.flatnonzero(np.diff(counters, prepend=before) != 1)
        self._counters += counters[starts].tolist()
        self._rows += (self.next_row + starts).tolist()
        self.next_row += len(block)
        self.next_counter = int(counters[-1]) + 1

    def row_of(self, counter: int) -> int:
        """Return the row of the first sample with at least this counter; -1 if none has."""
        if counter < 0 or self.next_counter is None or counter >= self.next_counter:
            return -1
        run = bisect_right(self._counters, counter) - 1
        if run < 0:
            return 0
        row = self._rows[run] + counter - self._counters[run]
        run_end = self._rows[run + 1] if run + 1 < len(self._rows) else self.next_row
        return min(row, run_end)


class PartWriter:
    """Writer of an open part. Call all methods in the writer's thread; they may raise OSError.

    ``add_*`` buffer rows and :meth:`write` appends them to the file.
    """

    def __init__(
        self,
        path: Path,
        layout: SessionLayout,
        attributes: Attributes,
        n_taxels: int,
        texts: tuple[str, str],
    ) -> None:
        self.path = path
        self._layout = layout
        self.counters = CounterMap()
        self.samples_written = 0
        self._blocks: list[SampleBlock] = []
        self._rows: dict[str, list[Row]] = {table.path: [] for table in layout.tables}
        _write_new(path, build_empty_part(layout, attributes, n_taxels, texts))
        self._file = h5py.File(
            _temporary_path(path), "r+", libver=LIBVER, rdcc_nbytes=CHUNK_CACHE_BYTES
        )
        self._datasets = {a.path: self._file[a.path] for a in layout.arrays}
        self._tables = {t.path: self._file[t.path] for t in layout.tables}
        try:
            self._start()
        except BaseException:
            self.abandon()
            raise

    def _start(self) -> None:
        """Switch to SWMR mode: readers may open the file from now on, so it gets its name."""
        self._file.swmr_mode = True
        self.sync()
        if _temporary_path(self.path) != self.path:
            _temporary_path(self.path).rename(self.path)
        _sync_folder(self.path.parent)

    def add_block(self, block: SampleBlock) -> None:
        """Buffer samples, their arrival and the gaps found with them."""
        if len(block):
            self.add_rows(ARRIVALS, [(self.counters.next_row, block.arrived_s)])
            self.counters.add(block)
            self._blocks.append(block)
        for gap in block.gaps:
            self.add_gap(gap)

    def add_gap(self, gap: Gap) -> None:
        """Buffer one gap; its row is that of the first sample after it."""
        row = self.counters.row_of(gap.first_counter)
        row = row if row >= 0 else self.counters.next_row
        reason = gap.reason.encode()[:32].decode(errors="ignore").encode()
        self.add_rows(GAPS, [(gap.first_counter, gap.count, row, reason)])

    def add_rows(self, table: TableLayout, rows: Sequence[Row]) -> None:
        """Buffer rows of one table."""
        self._rows[table.path].extend(rows)

    def write(self) -> None:
        """Append all buffered rows and flush them, samples first and trials last."""
        touched = self._write_samples()
        order = sorted(self._rows, key=lambda path: path == self._layout.trials.path)
        for path in order:
            rows, self._rows[path] = self._rows[path], []
            if rows:
                _append(self._tables[path], np.array(rows, dtype=self._tables[path].dtype))
                touched.append(self._tables[path])
        for dataset in touched:
            dataset.flush()
        self.samples_written = self.counters.next_row

    def sync(self) -> None:
        """Sync the written data to the medium (fsync)."""
        os.fsync(self._file.id.get_vfd_handle())

    def size_bytes(self) -> int:
        """Return the file's present size."""
        return os.fstat(self._file.id.get_vfd_handle()).st_size

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def abandon(self) -> None:
        """Close the file as its last complete flush left it, after a write failed.

        HDF5 keeps what it could not write and tries again when its objects close, which ends in
        a segmentation fault. So its descriptor first becomes one of the null device.
        """
        if os.name == "posix":
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, self._file.id.get_vfd_handle())
            os.close(null)
        self._file.close()

    def _write_samples(self) -> list[Any]:
        blocks, self._blocks = self._blocks, []
        if not blocks:
            return []
        for array in self._layout.arrays:
            rows = np.concatenate([getattr(block, array.field) for block in blocks])
            _append(self._datasets[array.path], rows)
        return list(self._datasets.values())


def _temporary_path(path: Path) -> Path:
    """Return a part's name until readers may open it; Windows cannot rename an open file."""
    return path.with_suffix(".new") if os.name == "posix" else path


def _write_new(path: Path, image: bytes) -> None:
    """Write an empty part without HDF5, which crashes if the disk fills meanwhile."""
    if path.exists():
        raise FileExistsError(errno.EEXIST, "a part is never written twice", str(path))
    temporary = _temporary_path(path)
    temporary.unlink(missing_ok=True)  # left by a writer that died while it created a part
    try:
        with temporary.open("xb") as file:
            file.write(image)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


def _append(dataset: Any, rows: Any) -> None:
    start = dataset.shape[0]
    dataset.resize(start + rows.shape[0], axis=0)
    dataset[start:] = rows


def _sync_folder(folder: Path) -> None:
    """Sync the new file's name to the medium; Windows has no such call and needs none."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
