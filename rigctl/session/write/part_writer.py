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

from rigctl.errors import DiskFault
from rigctl.session.format.data_sets import (
    DIGESTS,
    LIBVER,
    SessionLayout,
    TableLayout,
    build_empty_part,
)
from rigctl.session.format.digests import FIRST_DIGEST, PREVIOUS_DIGEST, DigestChain, describe_part
from rigctl.session.format.layout import ARRIVALS, GAPS
from rigctl.session.format.table_rows import Row
from rigctl.session.hdf5_file import Attributes
from rigctl.values import Gap

CHUNK_CACHE_BYTES = 1 << 20
"""For each data set: rows are appended and never read again, so the default of HDF5 2.0, 8 MiB,
would only fill up for the first hour of a recording."""

COPY_BYTES = 1 << 24


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

    ``add_*`` buffer rows and :meth:`write` appends them to the file, with their digests.
    ``previous_digest`` is the last digest of the session's part before this one.
    """

    def __init__(
        self,
        path: Path,
        layout: SessionLayout,
        attributes: Attributes,
        n_taxels: int,
        texts: tuple[str, str],
        previous_digest: str = FIRST_DIGEST,
    ) -> None:
        self.path = path
        self._layout = layout
        attributes = {**attributes, PREVIOUS_DIGEST: previous_digest}
        self.counters = CounterMap()
        self.samples_written = 0
        self._blocks: list[SampleBlock] = []
        self._rows: dict[str, list[Row]] = {table.path: [] for table in layout.tables}
        _write_new(path, build_empty_part(layout, attributes, n_taxels, texts))
        self._file = h5py.File(
            _temporary_path(path), "r+", libver=LIBVER, rdcc_nbytes=CHUNK_CACHE_BYTES
        )
        paths = [each.path for each in layout.arrays]
        paths += [each.path for each in (*layout.tables, DIGESTS)]
        self._datasets = {path: self._file[path] for path in paths}
        self._row_types = {path: dataset.dtype for path, dataset in self._datasets.items()}
        try:
            self._digests = DigestChain(previous_digest, describe_part(self._file))
            self._start()
        except BaseException:
            self.abandon()
            raise

    def _start(self) -> None:
        """Switch to SWMR mode: readers may open the file from now on, so it gets its name."""
        self._file.swmr_mode = True
        os.fsync(self._file.id.get_vfd_handle())
        if _temporary_path(self.path) != self.path:
            _temporary_path(self.path).rename(self.path)
        sync_folder(self.path.parent)

    def add_block(self, block: SampleBlock) -> None:
        """Buffer samples, their arrival and the gaps found with them."""
        if len(block):
            self.add_rows(ARRIVALS, [(self.counters.next_row, block.arrived_s)])
            self.add_samples(block)
        for gap in block.gaps:
            self.add_gap(gap)

    def add_samples(self, block: SampleBlock) -> None:
        """Buffer samples alone, of a layout without arrivals and gaps."""
        self.counters.add(block)
        self._blocks.append(block)

    def add_gap(self, gap: Gap) -> None:
        """Buffer one gap; its row is that of the first sample after it."""
        row = self.counters.row_of(gap.first_counter)
        row = row if row >= 0 else self.counters.next_row
        reason = gap.reason.encode()[:32].decode(errors="ignore").encode()
        self.add_rows(GAPS, [(gap.first_counter, gap.count, row, reason)])

    def add_rows(self, table: TableLayout, rows: Sequence[Row]) -> None:
        """Buffer rows of one table."""
        self._rows[table.path].extend(rows)

    @property
    def last_digest(self) -> str:
        """The digest of everything that :meth:`write` wrote."""
        return self._digests.last

    def write(self) -> None:
        """Append all buffered rows and flush them: samples, then tables, trials, digests."""
        touched = self._write_samples()
        order = sorted(self._rows, key=lambda path: path == self._layout.trials.path)
        for path in order:
            rows, self._rows[path] = self._rows[path], []
            if rows:
                touched.append(self._append_rows(path, np.array(rows, self._row_types[path])))
        digests = self._digests.take_rows()
        if digests:
            blocks = np.array(digests, self._row_types[DIGESTS.path])
            touched.append(_append(self._datasets[DIGESTS.path], blocks))
        for dataset in touched:
            dataset.flush()
        self.samples_written = self.counters.next_row

    def sync(self) -> None:
        """Sync the written data to the medium (fsync).

        Raises DiskFault if the file's path does not lead to the file any more: a file without a
        name is gone when it is closed.
        """
        descriptor = self._file.id.get_vfd_handle()
        os.fsync(descriptor)
        if not _leads_to(self.path, descriptor):
            raise DiskFault(
                f"{self.path} was removed, renamed or replaced while it was recorded; "
                f"{_save_again(self.path, descriptor)}: find out who touches that folder, then "
                "resume the session"
            )

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
            self._append_rows(array.path, rows.astype(self._row_types[array.path], copy=False))
        return [self._datasets[array.path] for array in self._layout.arrays]

    def _append_rows(self, path: str, rows: NDArray[Any]) -> Any:
        """Append rows of the data set's own type and add their digest; return the data set."""
        self._digests.add(path, rows)
        return _append(self._datasets[path], rows)


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


def _append(dataset: Any, rows: Any) -> Any:
    start = dataset.shape[0]
    dataset.resize(start + rows.shape[0], axis=0)
    dataset[start:] = rows
    return dataset


def _leads_to(path: Path, descriptor: int) -> bool:
    """Return whether a path is the name of an open file, on the same device."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except OSError:
        return False


def _save_again(path: Path, descriptor: int) -> str:
    """Write the contents of an open file that lost its name to a new file; say where they are."""
    target = path if not path.exists() else path.with_suffix(".saved")
    try:
        os.lseek(descriptor, 0, os.SEEK_SET)
        with target.open("xb") as copy:
            while block := os.read(descriptor, COPY_BYTES):
                copy.write(block)
            os.fsync(copy.fileno())
    except OSError as error:
        return f"what it held could not be saved ({error.strerror})"
    return f"what it held is in {target}"


def sync_folder(folder: Path) -> None:
    """Sync the names in a folder to the medium; Windows has no such call and needs none."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
