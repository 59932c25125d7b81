"""Chain digests over a session's rows, and find the rows that are not those recorded.

A digest is the SHA-256 of the digest before it, the place of the rows, and the rows as they are
stored. The first one of a part covers the part's description: attributes, texts and the types of
its data sets; it follows the last one of the part before. So no row can be changed, exchanged, left
out or added without another digest at the end of the session. ``docs/reference/trust.md`` says what
that proves.

A link of the chain needs only the digest before it, as stored. So each table can be checked alone,
and altered rows break one link only.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rigctl.session import layout
from rigctl.session.hdf5_file import (
    Hdf5File,
    hdf5_errors,
    open_image,
    read_attributes,
    read_text,
)
from rigctl.session.layout import DIGESTS, TEXTS, Row
from rigctl.session.part import PREVIOUS_DIGEST, PartReader, StructuredArray
from rigctl.session.session_reader import SessionReader
from rigctl.values import Verdict

FIRST_DIGEST = "0" * 64
"""Stands for the digest before the first one of a session."""
DESCRIPTION = "/"
"""``table`` of the row that covers the part's description."""
READ_BYTES = 8 << 20
"""Read at once: many blocks of a recording, whose flushes are small."""
MAX_NAMED = 3

OnBytes = Callable[[int], None]
"""Takes the number of bytes checked since the last call."""
OnProgress = Callable[[int, int], None]
"""Takes the bytes that are checked, and all bytes."""
Mask = NDArray[np.bool_]


def next_digest(
    previous: str, table: str, first_row: int, n_rows: int, rows: bytes | memoryview
) -> str:
    """Return the digest of ``rows`` as stored, little-endian in C order; SHA-256, hexadecimal."""
    digest = hashlib.sha256(f"{previous}{table}\n{first_row}\n{n_rows}\n".encode())
    digest.update(rows)
    return digest.hexdigest()


def describe_part(
    file: Any, empty: Mapping[str, Any] | None = None, own: Sequence[str] = ()
) -> bytes:
    """Return canonical JSON of all that an open part holds besides its rows.

    It has the root's attributes, both texts, and the type, the shape of a row and the attributes
    of each data set that grows. ``empty``: what :func:`describe_empty_part` returns for the part
    from which this one was built with attributes of its ``own``. Raises what h5py raises, and
    ValueError for other attributes.
    """
    if empty is None:
        described = _describe_file(file)
    else:
        described = {**empty, "attributes": empty["attributes"] | read_attributes(file, own)}
    return json.dumps(described, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()


@lru_cache(maxsize=4)
def describe_empty_part(image: bytes) -> Mapping[str, Any]:
    """Return what :func:`describe_part` writes of a part that is built from this one."""
    with open_image(image) as file:
        return _describe_file(file)


def _describe_file(file: Any) -> dict[str, Any]:
    texts = {path: read_text(file, path) for path, _ in TEXTS}
    return {"attributes": read_attributes(file), "objects": _describe_objects(file), "texts": texts}


def _describe_objects(file: Any) -> dict[str, Any]:
    objects: dict[str, Any] = {}
    file.visititems(lambda name, node: objects.update({f"/{name}": _describe(node)}))
    return objects


def _describe(node: Any) -> dict[str, Any]:
    attributes = read_attributes(node)
    if not isinstance(node, h5py.Dataset):
        return {"attributes": attributes}
    row = list(node.shape[1:])
    return {"attributes": attributes, "type": _type_name(node.dtype), "row": row}


def _type_name(dtype: np.dtype[Any]) -> Any:
    if dtype.names is None:
        return dtype.str
    return [[name, dtype[name].str] for name in dtype.names]


class DigestChain:
    """The digests of one part while it is written, after ``previous``, that of the part before."""

    def __init__(self, previous: str, description: bytes) -> None:
        self.last = previous
        self._n_rows: dict[str, int] = {}
        self._new: list[Row] = []
        self._add(DESCRIPTION, 0, 0, description)

    def add(self, table: str, rows: NDArray[Any]) -> None:
        """Cover rows that follow those covered so far; their type is the one in the file."""
        first = self._n_rows.get(table, 0)
        self._n_rows[table] = first + len(rows)
        self._add(table, first, len(rows), np.ascontiguousarray(rows).view(np.uint8).data)

    def take_rows(self) -> list[Row]:
        """Return the new rows of /digests, oldest first, and forget them."""
        taken, self._new = self._new, []
        return taken

    def _add(self, table: str, first_row: int, n_rows: int, rows: bytes | memoryview) -> None:
        self.last = next_digest(self.last, table, first_row, n_rows, rows)
        self._new.append((table.encode(), first_row, n_rows, self.last.encode()))


class DigestedFile(Protocol):
    """An open file whose rows are covered by digests: a part, or a stream beside them."""

    @property
    def path(self) -> Path:
        """Where it is."""

    @property
    def attributes(self) -> dict[str, Any]:
        """Those of its root."""

    @property
    def file(self) -> Hdf5File:
        """The file itself."""

    @property
    def is_growing(self) -> bool:
        """Whether a living writer may append to it."""

    def stored_lengths(self) -> dict[str, int]:
        """Return the rows of each data set that grows, by its path."""

    def stored_rows(self, path: str, start: int, stop: int) -> NDArray[Any]:
        """Return rows [start, stop) of a data set as stored, text as bytes."""


class RowRange(NamedTuple):
    """Rows ``first_row`` … ``first_row + n_rows - 1`` of a table."""

    table: str
    first_row: int
    n_rows: int

    @property
    def end(self) -> int:
        """The row after the last one."""
        return self.first_row + self.n_rows


@dataclass(frozen=True, slots=True)
class PartDamage:
    """What the digests of a part say about its rows.

    ``altered``: rows that are not those recorded; where a digest was altered itself, it is those
    that it covers and those of the next one. ``gone``: blocks whose last rows a table lacks.
    ``uncovered``: rows after the last digest, added later or of a killed writer's last flush.
    ``misplaced``: rows of /digests that belong to no table or do not follow the one before.
    """

    altered: tuple[RowRange, ...] = ()
    gone: tuple[RowRange, ...] = ()
    uncovered: tuple[RowRange, ...] = ()
    misplaced: tuple[int, ...] = ()


def check_digests(
    part: DigestedFile,
    tables: Collection[str] | None = None,
    on_bytes: OnBytes = lambda n: None,
) -> PartDamage:
    """Check the digests of the description and of ``tables``, all of them if None.

    A growing part has no damage: a reader must not delay its writer. Raises SessionError for a part
    that cannot be read.
    """
    if part.is_growing:
        return PartDamage()
    chain = _StoredChain(part)
    altered: list[RowRange] = []
    with ThreadPoolExecutor(1, "digests") as hasher:
        for path, rows in chain.rows_of.items():
            if tables is None or path == DESCRIPTION or path in tables:
                broken = chain.broken_links(path, rows, hasher, on_bytes)
                altered += map(chain.places.__getitem__, broken)
    lengths = part.stored_lengths()
    uncovered = (
        RowRange(path, chain.ends[path], length - chain.ends[path])
        for path, length in lengths.items()
        if path != DIGESTS.path and chain.ends[path] < length
    )
    merged = tuple(_merged(sorted(altered)))
    return PartDamage(merged, tuple(chain.gone), tuple(uncovered), tuple(chain.misplaced))


class _StoredChain:
    """The stored digests of a part, and which rows each of them covers.

    ``rows_of``: for each table, the rows of /digests that cover it from row 0 on, without a hole.
    SHA-256 takes as long as HDF5: ``hasher`` digests one batch while the next one is read.
    """

    def __init__(self, part: DigestedFile) -> None:
        self._part = part
        rows = part.stored_rows(DIGESTS.path, 0, part.stored_lengths()[DIGESTS.path])
        columns = (rows[name].tolist() for name in ("table", "first_row", "n_rows"))
        self.places = [
            RowRange(table.decode("ascii", "replace"), first, count)
            for table, first, count in zip(*columns, strict=True)
        ]
        self._digests: list[bytes] = rows["digest"].tolist()
        self._before = [str(part.attributes[PREVIOUS_DIGEST]).encode(), *self._digests]
        self._place_all(part.stored_lengths())

    def _place_all(self, lengths: Mapping[str, int]) -> None:
        paths = [DESCRIPTION, *(path for path in lengths if path != DIGESTS.path)]
        self.rows_of: dict[str, list[int]] = {path: [] for path in paths}
        self.ends = dict.fromkeys(paths, 0)
        self.misplaced: list[int] = []
        self.gone: list[RowRange] = []
        for row, place in enumerate(self.places):
            path, first, count = place
            if first != self.ends.get(path) or not _fits(path, row, count):
                self.misplaced.append(row)
                continue
            self.ends[path] = place.end
            if place.end > lengths.get(path, 0):
                self.gone.append(place)
            else:
                self.rows_of[path].append(row)

    def broken_links(
        self, path: str, rows: list[int], hasher: Executor, on_bytes: OnBytes
    ) -> Iterator[int]:
        """Yield the rows of /digests, of those that cover one table, whose link does not hold."""
        if path == DESCRIPTION:
            yield from (row for row in rows if not self._holds(row))
            return
        size = max(1, self._part.stored_rows(path, 0, 1).nbytes)
        before: tuple[Future[list[int]], int] | None = None
        for batch in self._batches(rows, READ_BYTES // size):
            first, end = self.places[batch[0]].first_row, self.places[batch[-1]].end
            stored = np.ascontiguousarray(self._part.stored_rows(path, first, end))
            data = stored.reshape(-1).view(np.uint8).data
            begun = hasher.submit(self._broken_in, batch, data, size)
            if before is not None:
                yield from before[0].result()
                on_bytes(before[1])
            before = begun, len(data)
        if before is not None:
            yield from before[0].result()
            on_bytes(before[1])

    def _holds(self, row: int) -> bool:
        with hdf5_errors(self._part.path, "its description"):
            described = describe_part(self._part.file.h5py_file)
        return self._digest(row, described) == self._digests[row]

    def _broken_in(self, batch: list[int], data: memoryview, size: int) -> list[int]:
        base = self.places[batch[0]].first_row
        broken = []
        for row in batch:
            start, end = (size * (at - base) for at in (self.places[row][1], self.places[row].end))
            if self._digest(row, data[start:end]) != self._digests[row]:
                broken.append(row)
        return broken

    def _digest(self, row: int, data: bytes | memoryview) -> bytes:
        previous = self._before[row].decode(errors="replace")
        return next_digest(previous, *self.places[row], data).encode()

    def _batches(self, rows: list[int], most_rows: int) -> Iterator[list[int]]:
        """Yield runs of digests of a table, to read what they cover at once."""
        batch: list[int] = []
        n_rows = 0
        for row in rows:
            count = self.places[row].n_rows
            if batch and n_rows + count > most_rows:
                yield batch
                batch, n_rows = [], 0
            batch.append(row)
            n_rows += count
        if batch:
            yield batch


def _fits(path: str, row: int, count: int) -> bool:
    """Return whether a digest may be in this row: the description's is the first and only it."""
    return count == 0 if path == DESCRIPTION else count > 0 and row > 0


def _merged(places: list[RowRange]) -> Iterator[RowRange]:
    """Join ranges that follow each other in a table."""
    last: RowRange | None = None
    for place in places:
        if last and last.table == place.table and last.end == place.first_row:
            last = last._replace(n_rows=last.n_rows + place.n_rows)
            continue
        if last:
            yield last
        last = place
    if last:
        yield last


def damaged_trials(
    session: SessionReader, on_progress: OnProgress = lambda done, total: None
) -> dict[int, str]:
    """Return the attempts whose rows were altered, by their index in ``session.trials``.

    The value says which rows. Reads what an analysis needs: trials, and what the layout says is
    analysed. Raises SessionError for a part that cannot be read.
    """
    tables = {*session.layout.analysed, session.layout.trials.path}
    total = sum(part.path.stat().st_size for part in session.parts)
    done, first_index = 0, 0
    reasons: dict[int, str] = {}

    def add(n: int) -> None:
        nonlocal done
        done += n
        on_progress(min(done, total), total)

    for part in session.parts:
        verdicts = part.rows(session.layout.trials)["verdict"]
        listed = np.isin(verdicts, list(Verdict))  # other rows are not among the session's
        index = first_index - 1 + np.cumsum(listed)
        for place in _of_tables(check_digests(part, tables, add), tables, part.finished):
            touched = touched_attempts(part, place)
            for trial in index[touched[listed[touched]]].tolist():
                reasons.setdefault(trial, describe_rows(place))
        first_index += int(listed.sum())
    on_progress(total, total)
    return reasons


def _of_tables(damage: PartDamage, tables: Collection[str], is_closed: bool) -> list[RowRange]:
    found = [*damage.altered, *damage.gone, *(damage.uncovered if is_closed else ())]
    return sorted(place for place in found if place.table in (DESCRIPTION, *tables))


def describe_rows(place: RowRange) -> str:
    """Return a sentence on altered rows."""
    table, first, n_rows = place
    if table == DESCRIPTION:
        return "the part's attributes or texts are not those that were recorded"
    if n_rows == 1:
        return f"row {first} of {table} is not the one that was recorded"
    return f"rows {first}–{place.end - 1} of {table} are not those that were recorded"


def touched_attempts(part: PartReader, place: RowRange) -> NDArray[np.int64]:
    """Return the rows of the part's /trials whose attempts need the rows of ``place``, int64.

    The rows themselves cannot be trusted: those directly before and after them say when, or at
    which samples or scans, they were written. A part's description concerns all of its attempts.
    """
    trials = part.rows(part.layout.trials)
    if place.table == DESCRIPTION:
        return np.arange(len(trials))
    if place.table == part.layout.trials.path:
        return np.arange(place.first_row, min(place.end, len(trials)))
    if place.table in part.lengths():
        return np.flatnonzero(_with_samples(trials, place.first_row, place.end - 1))
    for table in part.layout.tables:
        if table.path == place.table:
            return np.flatnonzero(_SELECT[table.place](part, table.place, trials, place))
    return np.empty(0, np.int64)


def name_attempts(part: PartReader, rows: NDArray[np.int64]) -> str:
    """Return the names of attempts for a sentence, the first of many."""
    trials = part.rows(part.layout.trials)[rows]
    names = [f"trial {row['trial_id']}, attempt {row['attempt']}" for row in trials[:MAX_NAMED]]
    if len(trials) > MAX_NAMED:
        names.append(f"{len(trials) - MAX_NAMED} more trials")
    return " and ".join(filter(None, ("; ".join(names[:-1]), *names[-1:]))) or "no trial"


def _with_samples(trials: StructuredArray, first: float, last: float) -> Mask:
    start = trials["first_sample"]
    mask: Mask = (start >= 0) & (start <= last) & (start + trials["count"] > first)
    return mask


def _by_samples(part: PartReader, column: str, trials: StructuredArray, place: RowRange) -> Mask:
    return _with_samples(trials, *_neighbours(part, place, column))


def _by_time(part: PartReader, column: str, trials: StructuredArray, place: RowRange) -> Mask:
    return _during(trials, *_neighbours(part, place, column))


def _by_board_time(part: PartReader, column: str, trials: StructuredArray, place: RowRange) -> Mask:
    first_us, last_us = _neighbours(part, place, column)
    polls = part.rows(layout.DRUM)
    before = polls["at_s"][polls[column] <= first_us]
    after = polls["at_s"][polls[column] >= last_us]
    first_s = before.max() if len(before) else -np.inf
    return _during(trials, first_s, after.min() if len(after) else np.inf)


def _during(trials: StructuredArray, first_s: float, last_s: float) -> Mask:
    mask: Mask = (trials["started_s"] <= last_s) & (trials["ended_s"] >= first_s)
    return mask


def _by_scan(part: PartReader, column: str, trials: StructuredArray, place: RowRange) -> Mask:
    first, last = _neighbours(part, place, column)
    mask: Mask = (trials[column] >= first) & (trials[column] <= last)
    return mask


_SELECT: Mapping[str, Callable[[PartReader, str, StructuredArray, RowRange], Mask]] = {
    "first_row": _by_samples,
    "row": _by_samples,
    "board_time_us": _by_board_time,
    "at_s": _by_time,
    "scan": _by_scan,
}
"""Selects the attempts of a range of rows, by the column that says where they belong."""


def _neighbours(part: PartReader, place: RowRange, column: str) -> tuple[Any, Any]:
    """Return a column's value in the row before a range and in the one after it."""
    before = part.stored_rows(place.table, max(0, place.first_row - 1), place.first_row)[column]
    after = part.stored_rows(place.table, place.end, place.end + 1)[column]
    return (
        before[0] if len(before) else -np.inf,
        after[0] if len(after) else np.inf,
    )
