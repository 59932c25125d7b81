"""Read a part's /digests, and find what its rows leave out, cover twice or cover nowhere."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rigctl.session.format.data_sets import DIGESTS
from rigctl.session.format.digests import DESCRIPTION
from rigctl.session.read.part import PartReader


class RowRange(NamedTuple):
    """Rows ``first_row`` … ``first_row + n_rows - 1`` of a table."""

    table: str
    first_row: int
    n_rows: int


@dataclass(frozen=True, slots=True)
class DigestTable:
    """The rows of /digests of one part, n of them.

    ``tables``: bytes; ``first_rows``, ``n_rows``: int64 (n,); ``digests``: bytes, each row's
    digest; ``lengths``: rows of each data set when the digests were read or later.
    """

    tables: list[bytes]
    first_rows: list[int]
    n_rows: list[int]
    digests: list[bytes]
    lengths: Mapping[str, int]

    def __len__(self) -> int:
        return len(self.digests)

    def place(self, row: int) -> RowRange:
        """Return the rows that a digest covers."""
        return RowRange(self.tables[row].decode(), self.first_rows[row], self.n_rows[row])


@dataclass(frozen=True, slots=True)
class DigestCoverage:
    """What the digests of a part cover.

    ``rows_of``: for each table, the rows of /digests that cover it from row 0 on, without a hole.
    ``misplaced``: rows of /digests that belong to no table or do not follow the one before.
    ``uncovered``: rows after the last digest. ``gone``: blocks whose last
    rows a table lacks.
    """

    rows_of: Mapping[str, list[int]]
    misplaced: tuple[int, ...]
    uncovered: tuple[RowRange, ...]
    gone: tuple[RowRange, ...]


def read_digest_table(part: PartReader) -> DigestTable:
    """Return the digests of a part that has some. Raises SessionError for a damaged one."""
    rows = part.stored_rows(DIGESTS.path, 0, part.n_rows(DIGESTS))
    lengths = part.stored_lengths()
    names = ("table", "first_row", "n_rows", "digest")
    tables, first_rows, n_rows, digests = (rows[name].tolist() for name in names)
    return DigestTable(tables, first_rows, n_rows, digests, lengths)


def check_coverage(table: DigestTable) -> DigestCoverage:
    """Return which digests cover which rows."""
    rows_of: dict[str, list[int]] = {path: [] for path in table.lengths if path != DIGESTS.path}
    rows_of[DESCRIPTION] = []
    ends = dict.fromkeys(rows_of, 0)
    names = {path.encode(): path for path in rows_of}
    misplaced, gone = [], []
    places = zip(table.tables, table.first_rows, table.n_rows, strict=True)
    for row, (encoded, first, count) in enumerate(places):
        path = names.get(encoded)
        if path is None or first != ends[path] or not _fits(path, row, count):
            misplaced.append(row)
            continue
        ends[path] = first + count
        if ends[path] > table.lengths.get(path, 0):
            gone.append(RowRange(path, first, count))
        else:
            rows_of[path].append(row)
    return DigestCoverage(
        rows_of, tuple(misplaced), tuple(_uncovered(table.lengths, ends)), tuple(gone)
    )


def _fits(path: str, row: int, count: int) -> bool:
    """Return whether a digest may be in this row: the description's is the first and only it."""
    return count == 0 if path == DESCRIPTION else count > 0 and row > 0


def _uncovered(lengths: Mapping[str, int], ends: Mapping[str, int]) -> Iterator[RowRange]:
    for path, length in lengths.items():
        if path != DIGESTS.path and ends[path] < length:
            yield RowRange(path, ends[path], length - ends[path])
