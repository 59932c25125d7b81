"""Where the samples of trials lie in a session's files, so that they are read without HDF5.

To open a part takes HDF5 ten milliseconds, and a slice of it a tenth of one, under a lock that all
threads share. But a part is not compressed: its samples are plain chunks at places that never
change. They are looked up once; after that any thread or process reads a trial with a file's own
``seek`` and ``read``. Only a part that still grows, or whose chunks somebody compressed, is left
to HDF5.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.session.read.part import PartReader, Structured

SAMPLES, COUNTER = "/taxels/samples", "/taxels/counter"
WORTH_LOOKING_UP = 16
"""For fewer single rows HDF5 is faster than to look up where they lie."""


@dataclass(frozen=True, slots=True)
class SampleFile:
    """The samples of one part.

    ``chunk_rows`` rows stand together at each of ``offsets`` (int64, bytes from the start of the
    file); ``offsets`` is None where only HDF5 can read them.
    """

    path: Path
    n_taxels: int
    chunk_rows: int
    offsets: NDArray[np.int64] | None


Files = Sequence[SampleFile] | Mapping[int, SampleFile]
"""Files by the number that a place tells."""


class SampleRange(NamedTuple):
    """Rows ``start`` … ``stop`` - 1 of a file hold a trial. ``complete``: none of it was lost."""

    file: int
    start: int
    stop: int
    complete: bool


def sample_file(part: PartReader) -> SampleFile:
    """Where the samples of a part lie."""
    dataset = part.array(SAMPLES)
    chunk_rows = dataset.chunks[0] if dataset.chunks else 0
    return SampleFile(
        part.path.absolute(), int(dataset.shape[1]), chunk_rows, _offsets(part, SAMPLES)
    )


def places_of(part: PartReader, rows: Structured, file: int) -> list[SampleRange]:
    """Where the windows of some trials of a part lie; ``rows``: theirs in /trials.

    A window is as many rows as its count, less where the counter jumps. Raises SessionError for
    a part that cannot be read.
    """
    start = np.maximum(rows["first_sample"], 0)
    count = np.where(rows["first_sample"] < 0, 0, rows["count"])
    stop = np.minimum(start + count, part.n_samples)
    behind = rows["first_counter"] + rows["count"]
    there = np.flatnonzero(stop > start)
    last = _counters_at(part, stop[there] - 1)
    for i in there[last >= behind[there]]:
        counters = part.read(COUNTER, int(start[i]), int(stop[i]))
        stop[i] = start[i] + np.searchsorted(counters, behind[i])
    whole = (stop - start == rows["count"]) & (stop > start)
    columns = (start.tolist(), np.maximum(stop, start).tolist(), whole.tolist())
    return list(map(SampleRange, [file] * len(rows), *columns))


class SampleReader:
    """Reads trials of some files; use it in a ``with``, in one thread."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._open: dict[int, BinaryIO | PartReader] = {}

    def __enter__(self) -> SampleReader:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for file in self._open.values():
            file.close()
        self._open.clear()

    def read(self, place: SampleRange, out: NDArray[np.uint16] | None = None) -> NDArray[np.uint16]:
        """Samples uint16 (n, n_taxels) of a trial, in ``out`` where it is given.

        Raises OSError or SessionError for what cannot be read.
        """
        if out is None:
            n_taxels = self._files[place.file].n_taxels
            out = np.empty((place.stop - place.start, n_taxels), np.uint16)
        self.read_all([place], out, [0])
        return out

    def read_all(
        self, places: Sequence[SampleRange], out: NDArray[np.uint16], begins: Sequence[int]
    ) -> None:
        """Samples of several trials into ``out`` (n, n_taxels), each from its row of ``begins`` on.

        Raises OSError or SessionError for what cannot be read.
        """
        pairs = zip(places, begins, strict=True)
        for number, some in groupby(pairs, key=lambda pair: pair[0].file):
            source, told = self._source(number), list(some)
            if isinstance(source, PartReader):
                for place, begin in told:
                    end = begin + place.stop - place.start
                    out[begin:end] = source.read(SAMPLES, place.start, place.stop)
            else:
                _read_pieces(source, _pieces(self._files[number], told), out)

    def _source(self, number: int) -> BinaryIO | PartReader:
        if number not in self._open:
            file = self._files[number]
            plain = file.offsets is not None
            self._open[number] = (
                file.path.open("rb", buffering=0) if plain else PartReader(file.path)
            )
        return self._open[number]


def _offsets(part: PartReader, path: str) -> NDArray[np.int64] | None:
    """Place of each chunk in the file, int64 bytes; None where that does not tell all."""
    dataset = part.array(path)
    as_in_memory = dataset.dtype in (np.dtype(np.uint16), np.dtype(np.int64))
    if part.grows or not dataset.chunks or dataset.id.get_create_plist().get_nfilters():
        return None
    if not as_in_memory or (dataset.ndim == 2 and dataset.chunks[1] != dataset.shape[1]):
        return None
    found: list[Any] = []
    dataset.id.chunk_iter(found.append)
    chunk_rows, n_rows = dataset.chunks[0], int(dataset.shape[0])
    offsets = np.full(-(-n_rows // chunk_rows), -1, np.int64)
    rows = np.array([chunk.chunk_offset[0] for chunk in found], np.int64)
    places = np.array([chunk.byte_offset for chunk in found], np.int64)
    inside = rows < n_rows
    offsets[rows[inside] // chunk_rows] = places[inside]
    return offsets if (offsets >= 0).all() else None


def _counters_at(part: PartReader, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """The board's counter at single rows, int64.

    It ascends, so that between two rows as far apart as their counters none is missing.
    """
    if not len(rows):
        return rows
    first, last = int(rows.min()), int(rows.max())
    low, high = (int(part.read(COUNTER, row, row + 1)[0]) for row in (first, last))
    if high - low == last - first:
        return low + (rows - first)
    out = np.empty((len(rows), 1), np.int64)
    offsets = _offsets(part, COUNTER) if len(rows) >= WORTH_LOOKING_UP else None
    if offsets is None:
        for i, row in enumerate(rows.tolist()):
            out[i] = part.read(COUNTER, row, row + 1)
        return out[:, 0]
    chunk_rows = part.array(COUNTER).chunks[0]
    size = out.itemsize
    at = offsets[rows // chunk_rows] + rows % chunk_rows * size
    if int(at.max()) + size > part.path.stat().st_size:
        raise SessionError(f"{part.path} is damaged: it ends before its samples do")
    with part.named():
        octets = np.memmap(part.path, np.uint8, "r")
        out[:] = octets[at[:, None] + np.arange(size)].view(np.int64)
    return out[:, 0]


def _pieces(
    file: SampleFile, told: Sequence[tuple[SampleRange, int]]
) -> Iterator[tuple[int, int, int]]:
    """Byte of the file, first byte and end in memory of each piece of trials and their begins.

    A piece is what one trial has in one chunk.
    """
    rows = np.array([(place.start, place.stop, begin) for place, begin in told], np.int64)
    start, stop, begin = rows.T
    first = start // file.chunk_rows
    counts = np.maximum((stop - 1) // file.chunk_rows - first + 1, 0)
    trial = np.repeat(np.arange(len(told)), counts)
    chunk = np.arange(len(trial)) - np.repeat(np.cumsum(counts) - counts - first, counts)
    row = np.maximum(start[trial], chunk * file.chunk_rows)
    end = np.minimum(stop[trial], (chunk + 1) * file.chunk_rows)
    size = file.n_taxels * np.dtype(np.uint16).itemsize
    assert file.offsets is not None
    at = file.offsets[chunk] + (row - chunk * file.chunk_rows) * size
    to = (begin - start)[trial]
    return zip(at.tolist(), ((to + row) * size).tolist(), ((to + end) * size).tolist(), strict=True)


def _read_pieces(
    file: BinaryIO, pieces: Iterable[tuple[int, int, int]], out: NDArray[np.uint16]
) -> None:
    """Fill the bytes of ``out`` with pieces of the file. Raises OSError where it ends."""
    target = out.reshape(-1).view(np.uint8).data
    for at, first, end in pieces:
        file.seek(at)
        _fill(file, target[first:end])


def _fill(file: Any, target: memoryview) -> None:
    while len(target):
        n = file.readinto(target)
        if not n:
            raise OSError("the file ends before its samples do")
        target = target[n:]
