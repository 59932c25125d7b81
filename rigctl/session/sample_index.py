"""Find the samples of trials in a session's files, and read them without HDF5.

HDF5 takes 10 ms to open a part and 0.1 ms for each slice of it, under a lock that all threads
share: too slow for an analysis of 24,000 trials in many threads and processes. But a part is not
compressed, and its chunks of samples never move. The index finds them once; after that, any thread
or process reads a trial with ``seek`` and ``readinto``. Growing parts and parts that another
program compressed are read through HDF5 (:mod:`rigctl.session.part`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.part import PartReader, StructuredArray
from rigctl.values import HELD_SAMPLES

SAMPLES, COUNTER = "/taxels/samples", "/taxels/counter"
MIN_ROWS_TO_INDEX = 16
"""For fewer single rows, HDF5 is faster than an index of their chunks."""


@dataclass(frozen=True, slots=True)
class SampleFile:
    """Chunks of the samples of one part.

    A chunk of ``chunk_rows`` rows begins at each of ``offsets`` (int64, bytes from the start of
    the file); ``offsets`` is None if only HDF5 can read them. ``inputs``: the input of each taxel
    where the samples are to become conductances, else empty. ``noise_counts``: deviation of normal
    noise that readers of trials add.
    """

    path: Path
    n_taxels: int
    chunk_rows: int
    offsets: NDArray[np.int64] | None
    inputs: tuple[int, ...] = ()
    noise_counts: float = 0.0


SampleFiles = Sequence[SampleFile] | Mapping[int, SampleFile]
"""Files by their number in :attr:`SampleRange.file`."""


class SampleRange(NamedTuple):
    """Rows ``start`` … ``stop`` - 1 of a file: one trial.

    ``complete``: each of its samples was received, or a reader gets the one before it instead, as
    the live encoder does: ``held`` has how often to repeat which of the rows.
    """

    file: int
    start: int
    stop: int
    complete: bool
    held: tuple[tuple[int, int], ...] = ()

    @property
    def n_samples(self) -> int:
        """Samples that a reader returns."""
        return self.stop - self.start + sum(count for _, count in self.held)


def locate_samples(part: PartReader) -> SampleFile:
    """Return the chunks of a part's samples."""
    chunks = part.file.chunk_shape(SAMPLES)
    n_taxels = part.file.shape(SAMPLES)[1]
    offsets = _chunk_offsets(part, SAMPLES)
    return SampleFile(part.path.absolute(), n_taxels, chunks[0] if chunks else 0, offsets)


def locate_windows(part: PartReader, rows: StructuredArray, file: int) -> list[SampleRange]:
    """Return the ranges of trials' windows in a part; ``rows`` are the trials' rows of /trials.

    A window has ``count`` rows, less those that are missing where the counter jumps. Raises
    SessionError for a part that HDF5 cannot read.
    """
    start = np.maximum(rows["first_sample"], 0)
    count = np.where(rows["first_sample"] < 0, 0, rows["count"])
    stop = np.minimum(start + count, part.n_samples)
    end_counter = rows["first_counter"] + rows["count"]
    filled = np.flatnonzero(stop > start)
    last = _counters_at(part, stop[filled] - 1)
    for i in filled[last >= end_counter[filled]]:
        counters = part.read(COUNTER, int(start[i]), int(stop[i]))
        stop[i] = start[i] + np.searchsorted(counters, end_counter[i])
    complete = (stop - start == rows["count"]) & (stop > start)
    columns = (start.tolist(), np.maximum(stop, start).tolist(), complete.tolist())
    found = list(map(SampleRange, [file] * len(rows), *columns))
    for i in np.flatnonzero(~complete & (stop > start)).tolist():
        found[i] = _hold(part, found[i], int(rows["first_counter"][i]), int(end_counter[i]))
    return found


def _hold(part: PartReader, window: SampleRange, first: int, end: int) -> SampleRange:
    """Return the range complete by held samples, where no gap is too long for that."""
    counters = part.read(COUNTER, window.start, window.stop)
    lost = np.diff(counters, append=end) - 1
    if counters[0] != first or lost.max() > HELD_SAMPLES:
        return window
    rows = np.flatnonzero(lost)
    return window._replace(
        complete=True, held=tuple(zip(rows.tolist(), lost[rows].tolist(), strict=True))
    )


class SampleReader:
    """Reader of trials from several files; use it in a ``with`` block, in one thread."""

    def __init__(self, files: SampleFiles) -> None:
        self._files = files
        self._open: dict[int, BinaryIO | PartReader] = {}

    def __enter__(self) -> SampleReader:
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._open.values():
            file.close()
        self._open.clear()

    def read(self, window: SampleRange) -> NDArray[np.uint16]:
        """Return the samples of a trial, uint16 (n, n_taxels).

        Raises OSError or SessionError for a file that it cannot read.
        """
        n_taxels = self._files[window.file].n_taxels
        out = np.empty((window.n_samples, n_taxels), np.uint16)
        self.read_all([window], out, [0])
        return out

    def read_all(
        self, windows: Sequence[SampleRange], out: NDArray[np.uint16], out_rows: Sequence[int]
    ) -> None:
        """Read several trials into ``out`` (n, n_taxels); ``out_rows``: the first row of each.

        Raises OSError or SessionError for a file that it cannot read.
        """
        pairs = zip(windows, out_rows, strict=True)
        for number, group in groupby(pairs, key=lambda pair: pair[0].file):
            source, targets = self._source(number), []
            for window, row in group:
                if window.held:
                    out[row : row + window.n_samples] = self._read_held(window)
                else:
                    targets.append((window, row))
            if isinstance(source, PartReader):
                for window, row in targets:
                    end = row + window.stop - window.start
                    out[row:end] = source.read(SAMPLES, window.start, window.stop)
            elif targets:
                _read_pieces(source, _split_by_chunk(self._files[number], targets), out)

    def _read_held(self, window: SampleRange) -> NDArray[np.uint16]:
        repeats = np.ones(window.stop - window.start, np.intp)
        for row, count in window.held:
            repeats[row] += count
        return np.repeat(self.read(window._replace(held=())), repeats, axis=0)

    def _source(self, number: int) -> BinaryIO | PartReader:
        if number not in self._open:
            file = self._files[number]
            raw = file.offsets is not None
            self._open[number] = file.path.open("rb", buffering=0) if raw else PartReader(file.path)
        return self._open[number]


def _chunk_offsets(part: PartReader, path: str) -> NDArray[np.int64] | None:
    """Return the byte offset of each chunk, int64; None if only HDF5 can read the chunks."""
    n_rows, *tail = part.file.shape(path)
    chunk = part.file.chunk_shape(path)
    native = part.file.dtype(path) in (np.dtype(np.uint16), np.dtype(np.int64))
    if part.is_growing or not native or not chunk or chunk[1:] != tuple(tail):
        return None
    addresses = part.file.chunk_addresses(path)
    if addresses is None:
        return None
    rows, starts = addresses
    chunk_rows = chunk[0]
    offsets = np.full(-(-n_rows // chunk_rows), -1, np.int64)
    inside = rows < n_rows
    offsets[rows[inside] // chunk_rows] = starts[inside]
    return offsets if (offsets >= 0).all() else None


def _counters_at(part: PartReader, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the board's counter at single rows, int64.

    If two rows are as far apart as their ascending counters, no sample between them is missing.
    """
    if not len(rows):
        return rows
    first, last = int(rows.min()), int(rows.max())
    low, high = (int(part.read(COUNTER, row, row + 1)[0]) for row in (first, last))
    if high - low == last - first:
        return low + (rows - first)
    offsets = _chunk_offsets(part, COUNTER) if len(rows) >= MIN_ROWS_TO_INDEX else None
    if offsets is None:
        return np.array([part.read(COUNTER, row, row + 1)[0] for row in rows.tolist()], np.int64)
    chunk_rows, size = part.file.chunk_shape(COUNTER)[0], np.dtype(np.int64).itemsize
    at = offsets[rows // chunk_rows] + rows % chunk_rows * size
    if int(at.max()) + size > part.path.stat().st_size:
        raise SessionError(f"{part.path} is damaged: it ends before its samples do")
    try:
        file_bytes = np.memmap(part.path, np.uint8, "r")  # twice as fast as a read for each row
    except OSError as error:
        raise SessionError(f"{part.path} cannot be read: {error.strerror or error}") from error
    values: NDArray[np.uint8] = np.asarray(file_bytes[at[:, None] + np.arange(size)])
    return values.view(np.int64)[:, 0]


def _split_by_chunk(
    file: SampleFile, targets: Sequence[tuple[SampleRange, int]]
) -> Iterator[tuple[int, int, int]]:
    """Split trials at the borders of chunks; ``targets``: ranges and their first rows in memory.

    Returns (byte in the file, first byte in memory, end in memory) for each piece.
    """
    rows = np.array([(window.start, window.stop, row) for window, row in targets], np.int64)
    start, stop, out_row = rows.T
    first = start // file.chunk_rows
    counts = np.maximum((stop - 1) // file.chunk_rows - first + 1, 0)
    trial = np.repeat(np.arange(len(targets)), counts)
    chunk = np.arange(len(trial)) - np.repeat(np.cumsum(counts) - counts - first, counts)
    row = np.maximum(start[trial], chunk * file.chunk_rows)
    end = np.minimum(stop[trial], (chunk + 1) * file.chunk_rows)
    size = file.n_taxels * np.dtype(np.uint16).itemsize
    assert file.offsets is not None
    at = file.offsets[chunk] + (row - chunk * file.chunk_rows) * size
    to = (out_row - start)[trial]
    return zip(at.tolist(), ((to + row) * size).tolist(), ((to + end) * size).tolist(), strict=True)


def _read_pieces(
    file: Any, pieces: Iterable[tuple[int, int, int]], out: NDArray[np.uint16]
) -> None:
    """Read pieces of the file into ``out``. Raises OSError if the file is too short."""
    target = out.reshape(-1).view(np.uint8).data
    for at, first, end in pieces:
        file.seek(at)
        piece = target[first:end]
        while len(piece):
            n = file.readinto(piece)
            if not n:
                raise OSError("the file ends before its samples do")
            piece = piece[n:]
