"""Text tables, read in chunks by pandas: the memory is that of their numbers."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import islice, repeat
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import open_file, shorten
from rigctl.errors import WrongUse
from rigctl.exchange.trial_tables import find_columns, refuse_too_many

if TYPE_CHECKING:
    import pandas

MAX_FILE_BYTES = 2**32
MAX_LINE_LETTERS = 1_000_000
HEAD_ROWS = 3
CHUNK_CELLS = 1_000_000
NumberedRow = tuple[int, list[str]]


class TextFormat(NamedTuple):
    """What divides cells and decimals, and how many lines stand before the header."""

    delimiter: str
    decimal: str = "."
    skip_lines: int = 0


class TextTable(NamedTuple):
    """A table of numbers: ``values`` float64 (n, m), NaN for an empty cell.

    ``row_numbers``: int64 (n,), the line of each row, from 1. ``truncated``: the last line is
    incomplete and left out. ``texts``: the different texts of each label column by its index;
    ``values`` then has the place of a row's text among them, from 0.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    row_numbers: NDArray[np.int64]
    truncated: bool
    texts: dict[int, tuple[str, ...]]


def read_text_table(
    path: Path, form: TextFormat, numbers: Sequence[str] | None = None, labels: Sequence[str] = ()
) -> TextTable:
    """Read a table of UTF-8 text; a first row that is no numbers has the names of the columns.

    A second row without numbers has their units and is left out. Rows may end in a delimiter that
    the names do not have.

    ``numbers``: the columns that must be numbers, None for all; others are NaN where they are
    texts. ``labels``: columns that may be texts. Raises WrongUse naming file, row and column.
    """
    head = first_rows(path, form, HEAD_ROWS)
    if not head:
        raise WrongUse(f"{path} is empty")
    number, cells = head[0]
    refuse_too_many(f"{path}, row {number}", len(cells))
    n_header = count_header_rows([row for _, row in head], form.decimal)
    names = tuple(cells) if n_header else tuple(str(k) for k in range(1, len(cells) + 1))
    before = head[n_header - 1][0] if n_header else form.skip_lines
    columns = _Columns(path, names, form, numbers, labels)
    if any(len(row) > len(names) for _, row in head[n_header:]):
        columns.check_lengths(before)
    columns.read(before)
    if not columns.values:
        raise WrongUse(f"{path} has no rows of values")
    return columns.table()


def first_rows(path: Path, form: TextFormat, count: int) -> list[NumberedRow]:
    """Return up to ``count`` rows with any content, with the numbers of their lines from 1."""
    with open_text(path) as file:
        return list(islice(_rows(path, file, form), count))


def read_first_lines(path: Path, count: int) -> list[tuple[int, str]]:
    """Return up to ``count`` lines with any content, with their numbers from 1.

    Raises WrongUse as :func:`read_text_table`.
    """
    with open_text(path) as file:
        lines = ((n, line.rstrip("\r\n")) for n, line in enumerate(_lines(path, file), 1))
        return list(islice(((n, line) for n, line in lines if line.strip()), count))


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """Open a text table. Raises WrongUse for a file that is too large or is no text in UTF-8."""
    with open_file(path) as binary:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise WrongUse(f"{path} has more than {MAX_FILE_BYTES:,} bytes: split it")
        with TextIOWrapper(binary, encoding="utf-8-sig", newline="") as file:
            try:
                yield file
            except (UnicodeDecodeError, csv.Error) as error:
                raise WrongUse(f"{path} is not a text table in UTF-8: {error}") from error


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    """Yield the lines. Raises WrongUse for one without an end in sight."""
    number = 0
    while line := file.readline(MAX_LINE_LETTERS + 1):
        number += 1
        if len(line) > MAX_LINE_LETTERS:
            raise WrongUse(
                f"{path}, row {number}: has more than {MAX_LINE_LETTERS:,} letters: this is no "
                "table of numbers"
            )
        yield line


def _rows(path: Path, file: TextIO, form: TextFormat) -> Iterator[NumberedRow]:
    """Yield the rows with any content, cells without spaces around them."""
    rows = csv.reader(islice(_lines(path, file), form.skip_lines, None), delimiter=form.delimiter)
    for row in rows:
        if any(row):
            yield form.skip_lines + rows.line_num, [cell.strip() for cell in row]


def count_header_rows(rows: Sequence[Sequence[str]], decimal: str = ".") -> int:
    """Return how many of the first three rows are a header: names, and units below them."""
    rows = [[cell.replace(decimal, ".") for cell in row] for row in rows]
    is_text = len(rows) == HEAD_ROWS and not any(cell and is_number(cell) for cell in rows[1])
    if is_text and _has_names(rows[1], rows[2]) and _has_names(rows[0], rows[2]):
        return 2
    return int(bool(rows) and _has_names(rows[0], rows[1] if len(rows) > 1 else ()))


def _has_names(first: Sequence[str], second: Sequence[str]) -> bool:
    """Return whether a first row has names: a text where the second has a number, or no cell."""
    below = (*second, *repeat("", len(first) - len(second)))
    return any(
        not is_number(cell) and is_number(under) for cell, under in zip(first, below, strict=False)
    )


class _Columns:
    """Collects the numbers of a table; texts of label columns become their place."""

    def __init__(
        self,
        path: Path,
        names: tuple[str, ...],
        form: TextFormat,
        numbers: Sequence[str] | None,
        labels: Sequence[str],
    ) -> None:
        self.values = array("d")
        self._path, self._names, self._form = path, names, form
        self._lines = array("q")
        self._cut_row: int | None = None
        every = range(len(names))
        self._numbers = set(every if numbers is None else find_columns(path, names, numbers))
        self._texts: dict[int, dict[str, int]] = {
            column: {} for column in find_columns(path, names, labels)
        }
        both = self._texts.keys() & self._numbers
        if both and numbers is not None:
            raise WrongUse(
                f"{path}: column {shorten(names[min(both)])} is mapped as a label and as numbers: "
                "leave out one"
            )

    def read(self, n_before: int) -> None:
        """Add all rows behind the first lines. Raises WrongUse for a wrong one."""
        import pandas

        width, delimiter = len(self._names), self._form.delimiter
        with open_text(self._path) as file:
            for _ in range(n_before):
                file.readline()
            try:
                with pandas.read_csv(
                    file,
                    sep=delimiter,
                    decimal=self._form.decimal,
                    header=None,
                    names=range(width + 1),  # one more shows rows that are too long
                    dtype=dict.fromkeys(self._texts, str),
                    keep_default_na=False,
                    na_values=[""],
                    skip_blank_lines=False,
                    chunksize=max(1, CHUNK_CELLS // width),
                    engine="c" if delimiter.isascii() else "python",
                    low_memory=not delimiter.isascii(),
                ) as chunks:
                    for chunk in chunks:
                        chunk.index += n_before + 1
                        self._add(chunk.dropna(how="all"), n_before)
            except pandas.errors.ParserError as error:
                self.check_lengths(n_before)
                raise WrongUse(f"{self._path} is not a text table in UTF-8: {error}") from error

    def table(self) -> TextTable:
        """Return what was read."""
        values = np.frombuffer(self.values, np.float64).reshape(-1, len(self._names))
        texts = {column: tuple(places) for column, places in self._texts.items()}
        lines = np.frombuffer(self._lines, np.int64)
        return TextTable(self._names, values, lines, bool(self._cut_row), texts)

    def _add(self, rows: pandas.DataFrame, n_before: int) -> None:
        width = len(self._names)
        # pandas fills short rows: only their cells tell them from rows that end in empty ones.
        if rows[width - 1].isna().any() or rows[width].notna().any():
            if self._cut_row is None:
                self._cut_row = 0
                self.check_lengths(n_before)
            rows = rows[rows.index != self._cut_row]
        columns = [self._column(column, rows[column]) for column in range(width)]
        self.values.frombytes(np.stack(columns, axis=1).tobytes())
        self._lines.frombytes(rows.index.to_numpy(np.int64).tobytes())

    def check_lengths(self, n_before: int) -> None:
        """Find a last row that is cut. Raises WrongUse for another row with too few or many cells.

        One empty cell may follow the last column.
        """
        width = len(self._names)
        with open_text(self._path) as file:
            rows = _rows(self._path, file, self._form._replace(skip_lines=n_before))
            for number, cells in rows:
                if len(cells) < width and next(rows, None) is None:
                    self._cut_row = number
                elif len(cells) < width or cells[width:] not in ([], [""]):
                    raise WrongUse(
                        f"{self._path}, row {number}: has {len(cells)} cells, the first has {width}"
                    )

    def _column(self, column: int, cells: pandas.Series) -> NDArray[np.float64]:
        if cells.dtype.kind in "iuf":
            return np.asarray(cells, np.float64)
        parse = self._place if column in self._texts else self._number
        pairs = zip(cells.index, cells.astype(object), strict=True)
        return np.array([parse(n, column, str(c).strip()) if c == c else np.nan for n, c in pairs])

    def _place(self, line: int, column: int, text: str) -> float:
        """Return the place of a label's text among the different ones of its column."""
        places = self._texts[column]
        return places.setdefault(text, len(places)) if text else np.nan

    def _number(self, line: int, column: int, cell: str) -> float:
        number = cell.replace(self._form.decimal, ".")
        if is_number(number):
            return float(number or "nan")
        if column in self._numbers:
            raise WrongUse(
                f"{self._path}, row {line}, column {shorten(self._names[column])}: "
                f"{shorten(cell)!r} is not a number"
            )
        return np.nan


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, or empty."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True
