"""One part's file under the writer's hand: rows are appended, flushed, synced; never rewritten."""

from __future__ import annotations

import errno
import os
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rigctl.session.format import layout
from rigctl.session.format.table_rows import Row
from rigctl.values import Block, Gap


class CounterMap:
    """Where in a part each board counter stands: one entry a run of samples without a gap."""

    def __init__(self) -> None:
        self._counters: list[int] = []
        self._rows: list[int] = []
        self.next_row = 0
        self.next_counter: int | None = None

    def add(self, block: Block) -> None:
        """Note the rows that ``block`` takes; its counters must ascend."""
        counters = block.counters
        if counters[0] != self.next_counter:
            self._open(int(counters[0]), self.next_row)
        for jump in np.flatnonzero(np.diff(counters) != 1) + 1:
            self._open(int(counters[jump]), self.next_row + int(jump))
        self.next_row += len(block)
        self.next_counter = int(counters[-1]) + 1

    def row_of(self, counter: int) -> int:
        """Row of the first sample whose counter is at least ``counter``; -1 if none is yet."""
        if counter < 0 or self.next_counter is None or counter >= self.next_counter:
            return -1
        run = bisect_right(self._counters, counter) - 1
        if run < 0:
            return 0
        row = self._rows[run] + counter - self._counters[run]
        behind_run = self._rows[run + 1] if run + 1 < len(self._rows) else self.next_row
        return min(row, behind_run)

    def _open(self, counter: int, row: int) -> None:
        self._counters.append(counter)
        self._rows.append(row)


class PartWriter:
    """An open part. All methods belong to the writer's thread and may raise OSError.

    Rows are gathered by ``add_*`` and reach the file with :meth:`write`.
    """

    def __init__(
        self,
        path: Path,
        attributes: dict[str, str | int | float],
        n_taxels: int,
        texts: tuple[str, str],
    ) -> None:
        self.path = path
        self.counters = CounterMap()
        self.samples_written = 0
        self._blocks: list[Block] = []
        self._rows: dict[str, list[Row]] = {table.path: [] for table in layout.TABLES}
        self._dtypes = {t.path: t.dtype for t in layout.TABLES}
        _write_new(path, layout.image(attributes, n_taxels, texts))
        self._file = h5py.File(_making(path), "r+", libver=layout.LIBVER)
        self._datasets = {a.path: self._file[a.path] for a in layout.TAXEL_ARRAYS}
        self._tables = {t.path: self._file[t.path] for t in layout.TABLES}
        try:
            self._start()
        except BaseException:
            self.abandon()
            raise

    def _start(self) -> None:
        """From here on the file can be read at any time, so it gets its name."""
        self._file.swmr_mode = True
        self.sync()
        if _making(self.path) != self.path:
            _making(self.path).rename(self.path)
        _sync_folder(self.path.parent)

    def add_block(self, block: Block) -> None:
        """Gather samples, their arrival and the gaps found with them."""
        if len(block):
            self.add_rows(layout.ARRIVALS, [(self.counters.next_row, block.arrived_s)])
            self.counters.add(block)
            self._blocks.append(block)
        for gap in block.gaps:
            self.add_gap(gap)

    def add_gap(self, gap: Gap) -> None:
        """Gather one gap; its row is that of the first sample behind it."""
        row = self.counters.row_of(gap.first_counter)
        place = row if row >= 0 else self.counters.next_row
        reason = gap.reason.encode()[:32].decode(errors="ignore").encode()
        self.add_rows(layout.GAPS, [(gap.first_counter, gap.count, place, reason)])

    def add_rows(self, table: layout.TableLayout, rows: Sequence[Row]) -> None:
        """Gather rows of one table."""
        self._rows[table.path].extend(rows)

    def write(self) -> None:
        """Append all that was gathered and flush it, samples first and trials last."""
        touched = self._write_samples()
        order = sorted(self._rows, key=lambda path: path == layout.TRIALS.path)
        for path in order:
            rows, self._rows[path] = self._rows[path], []
            if rows:
                _append(self._tables[path], np.array(rows, dtype=self._dtypes[path]))
                touched.append(self._tables[path])
        for dataset in touched:
            dataset.flush()
        self.samples_written = self.counters.next_row

    def sync(self) -> None:
        """Have the operating system put on the medium what was written."""
        os.fsync(self._file.id.get_vfd_handle())

    def size_bytes(self) -> int:
        """Bytes that the file has on disk now."""
        return os.fstat(self._file.id.get_vfd_handle()).st_size

    def close(self) -> None:
        """Close the file in order."""
        self._file.close()

    def abandon(self) -> None:
        """Let the file go as its last complete flush left it, after a write failed.

        HDF5 keeps what it could not write and tries again when its objects are closed, which
        ends in a segmentation fault. So its descriptor is first pointed at nowhere.
        """
        if os.name == "posix":
            nowhere = os.open(os.devnull, os.O_RDWR)
            os.dup2(nowhere, self._file.id.get_vfd_handle())
            os.close(nowhere)
        self._file.close()

    def _write_samples(self) -> list[Any]:
        blocks, self._blocks = self._blocks, []
        if not blocks:
            return []
        samples, counter, flags, edges = self._datasets.values()
        _append(samples, np.concatenate([b.samples for b in blocks]))
        _append(counter, np.concatenate([b.counters for b in blocks]))
        _append(flags, np.concatenate([b.flags for b in blocks]))
        _append(edges, np.concatenate([b.edges for b in blocks]))
        return [samples, counter, flags, edges]


def _making(path: Path) -> Path:
    """Name of a part until it can be read; Windows cannot rename an open file."""
    return path.with_suffix(".new") if os.name == "posix" else path


def _write_new(path: Path, image: bytes) -> None:
    """Write an empty part by plain means: HDF5 does not survive a disk that fills meanwhile."""
    if path.exists():
        raise FileExistsError(errno.EEXIST, "a part is never written twice", str(path))
    making = _making(path)
    making.unlink(missing_ok=True)  # left by a writer that died while it made a part
    try:
        with making.open("xb") as file:
            file.write(image)
    except OSError:
        making.unlink(missing_ok=True)
        raise


def _append(dataset: Any, rows: Any) -> None:
    start = dataset.shape[0]
    dataset.resize(start + rows.shape[0], axis=0)
    dataset[start:] = rows


def _sync_folder(folder: Path) -> None:
    """Make the new file's name durable; Windows has no such call and needs none."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
