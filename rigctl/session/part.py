"""Find and open the parts of a session, and read one: closed, growing, or left by a killed writer.

HDF5 itself opens a part whose writer was killed in SWMR mode only: there it waits for a writer to
repair what it cannot read, and never returns if the file is also truncated. So the program maps the
file copy-on-write and replaces the superblock in the map by one that has no open writer and the
file's real length. h5py reads the map like any file, and reports damage immediately. The file
itself does not change. Superblock versions 2 and 3 and their checksum: HDF5 File Format
Specification 3.0, sections II.A and VIII (Jenkins' lookup3).

Tables, texts and single trials come through here, and so do all samples that
:mod:`rigctl.session.sample_index` cannot read from the file directly: those of a growing part and
of one with compressed chunks.
"""

from __future__ import annotations

import mmap
import os
import struct
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import refuse_link_outside
from rigctl.errors import SessionError
from rigctl.experiments import DRUM_EXPERIMENT, EXPERIMENTS
from rigctl.session import layout
from rigctl.session.hdf5_file import DataSetSchema, Hdf5File, UnclosedFile, text
from rigctl.session.header import SessionHeader
from rigctl.session.layout import (
    DIGESTS,
    LIBVER,
    PART_PATTERN,
    TEXTS,
    SessionLayout,
    TableLayout,
    part_name,
    part_number,
)
from rigctl.session.writer_lock import is_being_written


def layout_of(attributes: Mapping[str, Any], path: Path) -> SessionLayout:
    """Return the layout of a part with these attributes; a part without experiment is the drum's.

    Raises SessionError for an experiment that this program does not know.
    """
    experiment = attributes.get("experiment", DRUM_EXPERIMENT)
    if not isinstance(experiment, str) or experiment not in EXPERIMENTS:
        raise SessionError(
            f"{path} is of experiment {experiment}, which this program does not know: use the "
            "rigctl that recorded it"
        )
    found: SessionLayout = EXPERIMENTS[experiment].load("layout")
    return found


def check_experiment(folder: Path, found: SessionLayout, wanted: SessionLayout) -> None:
    """Raise SessionError where a session is of another experiment than the one wanted."""
    if found.experiment != wanted.experiment:
        its = EXPERIMENTS[found.experiment]
        raise SessionError(
            f"{folder} is a session of {its.title}, not of "
            f"{EXPERIMENTS[wanted.experiment].title}: `{its.recorded_by}` resumes and "
            f"`{its.analysed_by}` reads it"
        )


@cache
def part_schema(layout: SessionLayout, n_taxels: int) -> tuple[DataSetSchema, ...]:
    """Return the data sets of a part in the order in which a growing one is opened.

    Tables come before the samples, because the writer flushes samples before their trial.
    """
    tables = [
        DataSetSchema(table.path, 1, dtype=table.dtype, tail=(), optional=table.optional)
        for table in layout.stored_tables
    ]
    arrays = [
        DataSetSchema(
            array.path,
            2 if array.per_taxel else 1,
            dtype=np.dtype(f"<{array.type_code}"),
            tail=(n_taxels,) if array.per_taxel else (),
        )
        for array in layout.arrays
    ]
    return (*tables, *arrays, *(text(path) for path, _ in TEXTS))


SIGNATURE = b"\x89HDF\r\n\x1a\n"
SUPERBLOCK_BYTES = 48
CHECKSUM_AT = 44
FLAGS_AT = 11
FILE_LENGTH_AT = 28
_MASK = 0xFFFFFFFF
_MIX_BITS = (4, 6, 8, 16, 19, 4)
_FINAL_BITS = (14, 11, 25, 16, 4, 14, 24)


def map_as_closed(path: Path) -> mmap.mmap:
    """Map the file into memory, its superblock closed in the map only.

    Raises OSError for a file without a superblock of version 2 or 3.
    """
    with path.open("rb") as file:
        if os.fstat(file.fileno()).st_size < SUPERBLOCK_BYTES:
            raise OSError("the file is too short, or it is not HDF5")
        view = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    view[:SUPERBLOCK_BYTES] = closed_superblock(view[:SUPERBLOCK_BYTES], len(view))
    return view


def lookup3(data: bytes) -> int:
    """Return Bob Jenkins' hashlittle with start value 0, the checksum of HDF5's metadata."""
    a = b = c = 0xDEADBEEF + len(data)
    blocks = list(struct.iter_unpack("<3I", data + bytes(-len(data) % 12)))
    for number, (x, y, z) in enumerate(blocks, start=1):
        a, b, c = (a + x) & _MASK, (b + y) & _MASK, (c + z) & _MASK
        if number == len(blocks):
            break
        for bits in _MIX_BITS:  # a, b and c take turns
            a, b, c = b, (c + b) & _MASK, ((a - c) ^ _rotate_left(c, bits)) & _MASK
    for bits in _FINAL_BITS:
        a, b, c = b, ((c ^ b) - _rotate_left(b, bits)) & _MASK, a
    return b


def _rotate_left(value: int, bits: int) -> int:
    return ((value << bits) | (value >> (32 - bits))) & _MASK


def closed_superblock(head: bytes, length: int) -> bytes:
    """Return the superblock without the flags of an open writer and with the file's length.

    Raises OSError for a file without a superblock of version 2 or 3.
    """
    if len(head) < SUPERBLOCK_BYTES or not head.startswith(SIGNATURE) or head[8] not in (2, 3):
        raise OSError("the file is too short, or it is not HDF5")
    closed = bytearray(head[:CHECKSUM_AT])
    closed[FLAGS_AT] = 0
    closed[FILE_LENGTH_AT : FILE_LENGTH_AT + 8] = struct.pack("<Q", length)
    return bytes(closed) + struct.pack("<I", lookup3(bytes(closed)))


PREVIOUS_DIGEST = "previous_digest"
"""Attribute of a part's root: the last digest of the part before it."""
CACHE: Mapping[str, Any] = {"rdcc_nbytes": 256 << 10, "rdcc_nslots": 61}
"""HDF5's chunk cache for each data set: its default of 8 MiB adds up over a session's parts, as do
8,191 places for chunks, of which so few bytes hold no more than these."""


def part_paths(folder: Path) -> list[Path]:
    """Return the files of the session's parts, in order. Raises SessionError if there are none."""
    parts = existing_parts(folder)
    if not parts:
        raise no_session(folder)
    return parts


def session_layout(folder: Path) -> SessionLayout:
    """Return the layout of a session's parts.

    The first part that can be read decides. Raises SessionError if none can, and for another kind
    of folder.
    """
    errors = []
    for part in part_paths(folder):
        try:
            with open_part(part) as file:
                return layout_of(file.attributes(), part)
        except SessionError as error:
            errors.append(error)
    raise errors[0]


def no_session(folder: Path) -> SessionError:
    """Return the error for a folder that holds no part of a session."""
    lack = "it contains no part-0001.h5" if folder.is_dir() else "there is no such folder"
    return SessionError(
        f"{folder} is not a session: {lack}; give the folder that rigctl run or rigctl demo made"
    )


def existing_parts(folder: Path) -> list[Path]:
    """Return the files that have the name of a part, in order."""
    paths = [path for path in folder.glob(PART_PATTERN) if part_number(path)]
    return sorted(paths, key=part_number)


def stray_files(folder: Path) -> list[str]:
    """Return the names of files that look like parts and are none, such as copies."""
    names = (path.name for path in folder.glob(PART_PATTERN) if not part_number(path))
    return sorted(names)


def open_part(path: Path) -> Hdf5File:
    """Open a part for reading, also while it grows or after its writer was killed.

    Raises SessionError for a damaged part, another layout version or another kind of file.
    """
    return _checked(open_appended(path, _is_growing(path)))


def _checked(file: Hdf5File) -> Hdf5File:
    try:
        _check_layout(file)
    except SessionError:
        file.close()
        raise
    return file


def _check_layout(file: Hdf5File) -> None:
    attributes = file.attributes()
    name, version = attributes.get("layout"), attributes.get("layout_version")
    if name != layout.LAYOUT:
        raise SessionError(f"{file.path} is an HDF5 file, but not a part of a rigctl session")
    if version != layout.LAYOUT_VERSION:
        raise SessionError(
            f"{file.path} has layout version {version}, this program reads "
            f"{layout.LAYOUT_VERSION}: use the rigctl that recorded it"
        )
    if PREVIOUS_DIGEST not in attributes:
        raise SessionError(
            f"{file.path} has no digests, it was recorded before 2026-11-23: read it with commit "
            "62bff220 of rigctl"
        )


def open_appended(path: Path, is_growing: bool) -> Hdf5File:
    """Open a file that is only ever appended to: closed, growing, or left by a killed writer.

    ``is_growing``: a living writer may have it open. Raises SessionError for a damaged file, and
    for a link that leads out of the session.
    """
    refuse_link_outside(path, SessionError)
    # A closed file opens directly, a growing one in SWMR mode and an unclosed one through a map.
    try:
        return Hdf5File(path, libver=LIBVER, **CACHE)
    except UnclosedFile:
        if is_growing:
            return Hdf5File(path, swmr=True, libver=LIBVER, **CACHE)
    return _map(path)


def _map(path: Path) -> Hdf5File:
    try:
        image = map_as_closed(path)
    except OSError as error:
        raise SessionError(f"{path} is damaged, HDF5 cannot open it: {error}") from error
    return Hdf5File(path, image=image, **CACHE)


def _is_growing(path: Path) -> bool:
    """Return whether a living writer appends to this part, which is then the session's last."""
    if path.with_name(part_name(part_number(path) + 1)).exists():
        return False  # as nearly always: a list of all parts, for each part, takes a second
    last = existing_parts(path.parent)[-1:]
    return [path.name] == [part.name for part in last] and is_being_written(path.parent)


def readable_rows(file: Hdf5File, path: str) -> int:
    """Return how many rows of a data set the file of an unclosed part holds, from the first on.

    A closed part that was cut short does not open at all; in one whose writer was killed, the last
    chunks may be beyond the end. Raises SessionError for chunks that HDF5 cannot find.
    """
    n_rows, chunk = file.shape(path)[0], file.chunk_shape(path)
    addresses = file.chunk_addresses(path)
    if not chunk or addresses is None:
        return n_rows
    present = set((addresses[0] // chunk[0]).tolist())
    absent = next(n for n in range(len(present) + 1) if n not in present)
    return min(n_rows, absent * chunk[0])


READ_AHEAD_ROWS = 500_000
_READ_BEHIND_ROWS = 8
"""Callers often read a window again from a few rows before it."""


Read = Callable[[int, int], NDArray[Any]]
"""Returns rows [start, stop) of an array."""


def read_blocks(read: Read, n_rows: int) -> Iterator[tuple[int, NDArray[Any]]]:
    """Read a whole array in blocks; yield each one's first row and its rows."""
    for start in range(0, n_rows, READ_AHEAD_ROWS):
        yield start, read(start, min(n_rows, start + READ_AHEAD_ROWS))


class BufferedArray:
    """Windows of an array of ``n_rows``.

    The buffer serves the windows that follow, so it reads each row about once and holds no more
    than ``READ_AHEAD_ROWS`` or the longest window.
    """

    def __init__(self, read: Read, n_rows: int) -> None:
        self._read = read
        self._n_rows = n_rows
        self._first = 0
        self._rows: NDArray[Any] | None = None

    def window(self, start: int, stop: int) -> NDArray[Any]:
        """Return rows ``start`` … ``stop`` - 1, cut at the array's end; do not write to them."""
        stop = min(stop, self._n_rows)
        rows = self._rows
        if rows is None or start < self._first or stop > self._first + len(rows):
            self._first = max(0, start - _READ_BEHIND_ROWS)
            read_to = min(self._n_rows, self._first + READ_AHEAD_ROWS)
            rows = self._rows = self._read(self._first, max(stop, read_to))
        return rows[start - self._first : max(start, stop) - self._first]


LIVE_SLICE_ROWS = 5_000
"""Larger reads of a growing file would delay a writer in the same process for long."""

StructuredArray = NDArray[np.void]


class PartReader:
    """Rows of one part as of the last :meth:`refresh`.

    After :meth:`close` its description, its lengths and its attempts are known; whatever else is
    asked for opens the file again.

    ``is_cut``: its writer was killed. ``cut_rows``: how many rows of each data set are beyond the
    end of a killed part that was also cut short; they do not count.

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
        self._opened: Hdf5File | None = open_part(self.path)
        try:
            self._check()
        except SessionError:
            self.close()
            raise

    def _check(self) -> None:
        """Check the description and every data set before any data is read."""
        self.attributes = self.file.attributes()
        self.is_cut, self._is_growing = self.file.is_cut, self.file.is_growing
        self.layout = layout_of(self.attributes, self.path)
        self.header = SessionHeader.from_attributes(self.attributes, self.path)
        self.file.check(part_schema(self.layout, self.header.n_taxels))
        self._n_rows, self.cut_rows = self._count_rows()
        self._values: dict[tuple[str, str, int], float] = {}
        self.n_samples = min(self.lengths().values())
        self.finished = self._ends_with(layout.PART_END_KIND)
        trials = self.layout.trials
        self._attempts = self.stored_rows(trials.path, 0, self.n_rows(trials))

    def _count_rows(self) -> tuple[dict[str, int], dict[str, int]]:
        """Return the rows of each data set that the file holds, and how many it lacks."""
        paths = [array.path for array in self.layout.arrays]
        paths += [table.path for table in self.layout.stored_tables]
        lengths = {path: self.file.shape(path)[0] for path in paths}
        if not self.file.is_cut:
            return lengths, {}
        held = {path: self._readable_rows(path) for path in paths}
        return held, {path: lengths[path] - n for path, n in held.items() if n < lengths[path]}

    def _readable_rows(self, path: str) -> int:
        """Return the rows of a data set that the file holds; none if it lacks their places."""
        try:
            return readable_rows(self.file, path)
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
        return bool(n_rows and self.file.row(path, n_rows - 1)["kind"] == kind.encode())

    @property
    def last_digest(self) -> str:
        """The last digest; empty if a killed writer left none."""
        n_rows = self.n_rows(DIGESTS)
        return str(self.rows(DIGESTS, n_rows - 1)["digest"][0]) if n_rows else ""

    @property
    def is_growing(self) -> bool:
        """Whether a living writer may append to it."""
        return self._is_growing

    @property
    def file(self) -> Hdf5File:
        """The open file, its data sets checked; rows are as stored."""
        if self._opened is None:
            self._open()
        assert self._opened is not None
        return self._opened

    def attempts(self) -> StructuredArray:
        """Return the rows of /trials; text as Unicode."""
        return self._decode_rows(self.layout.trials, self._attempts)

    def n_rows(self, table: TableLayout) -> int:
        """Return the number of rows of a table."""
        return self._n_rows.get(table.path, 0)

    def lengths(self) -> dict[str, int]:
        """Return the rows of each per-sample data set; after a kill they differ by one flush."""
        return {array.path: self._n_rows[array.path] for array in self.layout.arrays}

    def stored_lengths(self) -> dict[str, int]:
        """Return the rows of each data set that grows, by its path."""
        return {**self.lengths(), **{t.path: self.n_rows(t) for t in self.layout.stored_tables}}

    def stored_rows(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of an array or table as stored, text as bytes."""
        return self.file.rows(path, start, stop)

    def rows(self, table: TableLayout, start: int = 0, stop: int | None = None) -> StructuredArray:
        """Return rows of a table; text as Unicode."""
        n_rows = self.n_rows(table)
        stop = n_rows if stop is None else min(stop, n_rows)
        return self._decode_rows(table, self.file.rows(table.path, start, stop))

    def rows_where(self, table: TableLayout, column: str, text: str) -> StructuredArray:
        """Return the rows with ``text`` in a column; only these are decoded."""
        raw = self.file.rows(table.path, 0, self.n_rows(table))
        return self._decode_rows(table, raw[raw[column] == text.encode()])

    def read(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of a per-sample data set, read in slices while it grows."""
        stop = min(stop, self.n_samples)
        if not self.is_growing:
            return self.file.rows(path, start, stop)
        tail = self.file.shape(path)[1:]
        out = np.empty((max(0, stop - start), *tail), self.file.dtype(path))
        for first in range(start, stop, LIVE_SLICE_ROWS):
            last = min(stop, first + LIVE_SLICE_ROWS)
            out[first - start : last - start] = self.file.rows(path, first, last)
        return out

    def rows_between(
        self, table: TableLayout, column: str, first: float, last: float
    ) -> StructuredArray:
        """Return the rows with ``first`` ≤ ``column`` ≤ ``last``, an ascending column."""
        chunk = table.chunk_rows
        begins = range(0, self.n_rows(table), chunk)
        start = bisect_left(begins, first, key=partial(self._value, table.path, column))
        stop = bisect_right(begins, last, key=partial(self._value, table.path, column))
        end = min(stop * chunk, self.n_rows(table))
        raw = self.file.rows(table.path, max(0, start - 1) * chunk, end)
        inside = slice(
            np.searchsorted(raw[column], first), np.searchsorted(raw[column], last, side="right")
        )
        return self._decode_rows(table, raw[inside])

    def _value(self, path: str, column: str, row: int) -> float:
        """Return a value of a table, kept for the next search: written rows do not change."""
        key = path, column, row
        if key not in self._values:
            self._values[key] = float(self.file.row(path, row)[column])
        return self._values[key]

    def text(self, path: str) -> str:
        """Return the protocol or the rig's description."""
        return self.file.text(path)

    def dataset_attributes(self) -> dict[str, dict[str, Any]]:
        """Return the attributes of each data set by its path."""
        paths = [a.path for a in self.layout.arrays] + [t.path for t in self.layout.tables]
        return {path: self.file.attributes(path) for path in paths}

    def leave(self) -> None:
        """Let go of all that is open in the file, before it is closed."""
        if self._opened is not None:
            self._opened.leave()

    def close(self) -> None:
        """Close the file."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    def _decode_rows(self, table: TableLayout, raw: StructuredArray) -> StructuredArray:
        dtype = [(c.name, c.type_code.replace("S", "U")) for c in table.columns]
        rows: StructuredArray = np.empty(raw.shape, dtype)
        for column in table.columns:
            lacks = column.optional and column.name not in (raw.dtype.names or ())
            values = np.full(raw.shape, np.nan) if lacks else raw[column.name]
            rows[column.name] = _decode_texts(values) if column.text_bytes else values
        return rows


def _decode_texts(column: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """Return UTF-8 as Unicode; decode each of a long column's few different texts once."""
    unique, inverse = np.unique(column, return_inverse=True)
    decoded = np.array([text.decode(errors="replace") for text in unique], dtype=np.str_)
    texts: NDArray[np.str_] = decoded[inverse] if len(decoded) else decoded.astype("U1")
    return texts
