"""Check the links of a part's chain of digests: each digest against the rows that it covers.

A link needs only the digest before it, as stored. So each table can be checked alone and in
order, and altered rows break one link only. Where the digest before was altered itself, both its
own link and the next one break, and both hold again with the digest that its rows give.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from rigctl.session.chain.digest_table import (
    DigestCoverage,
    DigestTable,
    RowRange,
    check_coverage,
    read_digest_table,
)
from rigctl.session.format.digests import DESCRIPTION, PREVIOUS_DIGEST, next_digest
from rigctl.session.read.part import PartReader

READ_BYTES = 8 << 20
"""Read at once: many blocks of a recording, whose flushes are small."""
MAX_SEARCHES = 500
MAX_ALTERED_DIGESTS = 8
"""Neighbouring digests that are searched for altered ones."""

OnBytes = Callable[[int], None]
"""Takes the number of bytes checked since the last call."""


@dataclass(frozen=True, slots=True)
class PartLinks:
    """What the digests of a part say about its rows.

    ``damaged``: rows that are not those recorded. ``altered``: rows of /digests that were altered
    themselves, though what they cover is intact.
    """

    coverage: DigestCoverage
    damaged: tuple[RowRange, ...] = ()
    altered: tuple[int, ...] = ()


def check_links(
    part: PartReader,
    tables: Collection[str] | None = None,
    follower: str = "",
    on_bytes: OnBytes = lambda n: None,
) -> PartLinks:
    """Check the digests of the description and of ``tables``, all of them if None.

    ``follower``: the digest that the next part or ``digests.txt`` has for this part, "" if none
    has. Raises SessionError for a part that cannot be read.
    """
    table = read_digest_table(part)
    coverage = check_coverage(table)
    previous = str(part.attributes.get(PREVIOUS_DIGEST, ""))
    broken: list[int] = []
    with ThreadPoolExecutor(1, "digests") as hasher:
        chain = _Chain(part, table, coverage, previous, hasher)
        for path, rows in coverage.rows_of.items():
            if tables is None or path == DESCRIPTION or path in tables:
                broken += chain.broken_links(path, rows, on_bytes)
        damaged, altered = chain.explain(sorted(broken), follower)
    places = sorted(table.place(row) for row in damaged)
    return PartLinks(coverage, tuple(_merged(places)), tuple(altered))


class _Chain:
    """The stored digests of a part, and those that its rows give.

    SHA-256 takes as long as HDF5: ``hasher`` digests one batch while the next one is read.
    """

    def __init__(
        self,
        part: PartReader,
        table: DigestTable,
        coverage: DigestCoverage,
        previous: str,
        hasher: Executor,
    ) -> None:
        self._part = part
        self._hasher = hasher
        self._table = table
        self._placed = {row for rows in coverage.rows_of.values() for row in rows}
        self._before = [previous.encode(), *table.digests]

    def broken_links(self, path: str, rows: list[int], on_bytes: OnBytes) -> Iterator[int]:
        """Yield the rows of /digests, of those that cover one table, whose link does not hold."""
        if path == DESCRIPTION:
            yield from (row for row in rows if not self._holds(row))
            return
        size = max(1, self._part.stored_rows(path, 0, 1).nbytes)
        before: tuple[Future[list[int]], int] | None = None
        for batch in _batches(rows, self._table, READ_BYTES // size):
            first = self._table.first_rows[batch[0]]
            end = self._table.first_rows[batch[-1]] + self._table.n_rows[batch[-1]]
            data = _bytes_of(self._part, path, first, end)
            begun = self._hasher.submit(self._broken_in, path, batch, data, size)
            if before is not None:
                yield from before[0].result()
                on_bytes(before[1])
            before = begun, len(data)
        if before is not None:
            yield from before[0].result()
            on_bytes(before[1])

    def _broken_in(self, path: str, batch: list[int], data: memoryview, size: int) -> list[int]:
        table, before = self._table, self._before
        broken = []
        base = table.first_rows[batch[0]]
        for row in batch:
            first, n_rows = table.first_rows[row], table.n_rows[row]
            start = (first - base) * size
            digest = next_digest(
                before[row].decode(errors="replace"),
                path,
                first,
                n_rows,
                data[start : start + n_rows * size],
            )
            if digest.encode() != table.digests[row]:
                broken.append(row)
        return broken

    def explain(self, broken: list[int], follower: str) -> tuple[list[int], list[int]]:
        """Return the rows whose own data were altered, and those that were altered themselves.

        ``broken``: the rows of /digests whose link does not hold, in their order.
        """
        damaged: list[int] = []
        altered: list[int] = []
        done = -1
        for number, row in enumerate(broken):
            if row <= done:
                continue
            agrees = -1 if number >= MAX_SEARCHES else self._search(row, follower)
            if agrees < 0:
                damaged.append(row)
                continue
            done = agrees
            altered += range(row, agrees)
        return damaged, altered

    def _search(self, row: int, follower: str) -> int:
        """Follow the digests that the rows give, from one that is not as stored.

        Return the first row whose stored digest agrees again; the number of digests stands for
        ``follower``. -1 if none agrees, so the rows themselves were altered.
        """
        digest = self._before[row].decode(errors="replace")
        for at in range(row, min(row + MAX_ALTERED_DIGESTS, len(self._table))):
            if at not in self._placed:
                return -1
            digest = self._digest(at, digest)
            if digest.encode() == self._table.digests[at]:
                return at
        at_end = row + MAX_ALTERED_DIGESTS >= len(self._table)
        return len(self._table) if at_end and digest == follower else -1

    def _holds(self, row: int) -> bool:
        digest = self._digest(row, self._before[row].decode(errors="replace"))
        return digest.encode() == self._table.digests[row]

    def _digest(self, row: int, previous: str) -> str:
        path, first, n_rows = self._table.place(row)
        if path == DESCRIPTION:
            return next_digest(previous, path, first, n_rows, self._part.describe())
        return next_digest(
            previous, path, first, n_rows, _bytes_of(self._part, path, first, first + n_rows)
        )


def _bytes_of(part: PartReader, path: str, start: int, stop: int) -> memoryview:
    rows = np.ascontiguousarray(part.stored_rows(path, start, stop))
    return rows.reshape(-1).view(np.uint8).data


def _batches(rows: list[int], table: DigestTable, most_rows: int) -> Iterator[list[int]]:
    """Yield runs of digests that follow each other in a table, to read what they cover at once."""
    batch: list[int] = []
    n_rows = 0
    for row in rows:
        follows = batch and table.first_rows[row] == (
            table.first_rows[batch[-1]] + table.n_rows[batch[-1]]
        )
        if batch and (not follows or n_rows + table.n_rows[row] > most_rows):
            yield batch
            batch, n_rows = [], 0
        batch.append(row)
        n_rows += table.n_rows[row]
    if batch:
        yield batch


def _merged(places: list[RowRange]) -> Iterator[RowRange]:
    """Join ranges that follow each other in a table."""
    last: RowRange | None = None
    for place in places:
        if last and last.table == place.table and sum(last[1:]) == place.first_row:
            last = last._replace(n_rows=last.n_rows + place.n_rows)
            continue
        if last:
            yield last
        last = place
    if last:
        yield last
