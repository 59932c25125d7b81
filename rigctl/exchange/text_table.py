"""Text tables, read row by row: the memory is that of their numbers, and no line is endless."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import chain, islice, repeat
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import open_file, shorten
from rigctl.errors import WrongUse
from rigctl.exchange.trial_tables import find_columns, refuse_too_many

MAX_FILE_BYTES = 2**32
MAX_LINE_LETTERS = 1_000_000
MAX_LABELS = 100_000
HEAD_ROWS = 3


class TextFormat(NamedTuple):
    """What divides cells and decimals, and how many lines stand before the header."""

    delimiter: str
    decimal: str = "."
    skip_lines: int = 0

    def cells(self, row: Sequence[str]) -> list[str]:
        """Return cells without spaces around them, numbers with a decimal point."""
        cells = [cell.strip() for cell in row]
        return [self._number(cell) for cell in cells] if self.decimal != "." else cells

    def _number(self, cell: str) -> str:
        number = cell.replace(self.decimal, ".")
        return number if is_number(number) else cell


class TextTable(NamedTuple):
    """A table of numbers: ``values`` float64 (n, m), NaN for an empty cell.

    ``first_row``: line of the first values, from 1. ``truncated``: the last line is incomplete
    and left out. ``texts``: the different texts of each label column by its index; ``values``
    then has the place of a row's text among them, from 0.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    first_row: int
    truncated: bool
    texts: dict[int, tuple[str, ...]]


def read_text_table(
    path: Path, form: TextFormat, numbers: Sequence[str] | None = None, labels: Sequence[str] = ()
) -> TextTable:
    """Read a table of UTF-8 text; a first row that is no numbers has the names of the columns.

    A second row without numbers has their units and is left out.

    ``numbers``: the columns that must be numbers, None for all; others are NaN where they are
    texts. ``labels``: columns that may be texts. Raises WrongUse naming file, row and column.
    """
    with open_text(path) as file:
        lines = islice(_lines(path, file), form.skip_lines, None)
        rows = _numbered_rows(csv.reader(lines, delimiter=form.delimiter), form)
        return _read_rows(path, rows, numbers, labels)


def read_first_lines(path: Path, count: int, skip_lines: int = 0) -> list[tuple[int, str]]:
    """Return up to ``count`` lines with any content, with their numbers from 1.

    Raises WrongUse as :func:`read_text_table`.
    """
    with open_text(path) as file:
        lines = ((n, line.rstrip("\r\n")) for n, line in enumerate(_lines(path, file), 1))
        full = ((n, line) for n, line in lines if n > skip_lines and line.strip())
        return list(islice(full, count))


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


def _numbered_rows(rows: Iterator[list[str]], form: TextFormat) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows with any content and their numbers."""
    for number, row in enumerate(rows, form.skip_lines + 1):
        if any(row):
            yield number, form.cells(row)


def _read_rows(
    path: Path,
    rows: Iterator[tuple[int, list[str]]],
    numbers: Sequence[str] | None,
    labels: Sequence[str],
) -> TextTable:
    head = list(islice(rows, HEAD_ROWS))
    if not head:
        raise WrongUse(f"{path} is empty")
    number, cells = head[0]
    refuse_too_many(f"{path}, row {number}", len(cells))
    n_header = count_header_rows([row for _, row in head])
    names = tuple(cells) if n_header else tuple(str(k) for k in range(1, len(cells) + 1))
    parser = _RowParser(path, names, numbers, labels)
    first_row, truncated = _read_values(parser, chain(head[n_header:], rows))
    if not parser.values:
        raise WrongUse(f"{path} has no rows of values")
    table = np.frombuffer(parser.values, np.float64).reshape(-1, len(names))
    return TextTable(names, table, first_row, truncated, parser.texts())


def count_header_rows(rows: Sequence[Sequence[str]]) -> int:
    """Return how many of the first three rows are a header: names, and units below them."""
    has_units = len(rows) == HEAD_ROWS and _are_texts(rows[1]) and _has_names(rows[1], rows[2])
    if has_units and _has_names(rows[0], rows[2]):
        return 2
    return int(bool(rows) and _has_names(rows[0], rows[1] if len(rows) > 1 else ()))


def _are_texts(row: Sequence[str]) -> bool:
    return not any(cell and is_number(cell) for cell in row)


def _has_names(first: Sequence[str], second: Sequence[str]) -> bool:
    """Return whether a first row has names: a text where the second has a number, or no cell."""
    below = (*second, *repeat("", len(first) - len(second)))
    return any(
        not is_number(cell) and is_number(under) for cell, under in zip(first, below, strict=False)
    )


def _read_values(parser: _RowParser, rows: Iterator[tuple[int, list[str]]]) -> tuple[int, bool]:
    """Add all rows; return the number of the first, and whether the last is cut.

    A row with too few cells is refused unless it is the last one.
    """
    first_row = 0
    for number, cells in rows:
        first_row = first_row or number
        if len(cells) < len(parser.names) and next(rows, None) is None:
            return first_row, True
        parser.add(number, cells)
    return first_row, False


class _RowParser:
    """Turns the rows of a table into numbers; texts of label columns become their place."""

    def __init__(
        self,
        path: Path,
        names: tuple[str, ...],
        numbers: Sequence[str] | None,
        labels: Sequence[str],
    ) -> None:
        self.names = names
        self.values = array("d")
        self._path = path
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

    def add(self, number: int, row: list[str]) -> None:
        """Add the row with this line number. Raises WrongUse for a wrong one."""
        if len(row) != len(self.names):
            raise WrongUse(
                f"{self._path}, row {number}: has {len(row)} cells, the first has {len(self.names)}"
            )
        for column, places in self._texts.items():
            row[column] = str(places.setdefault(row[column], len(places))) if row[column] else ""
            if len(places) > MAX_LABELS:
                raise WrongUse(
                    f"{self._path}, row {number}, column {shorten(self.names[column])}: more than "
                    f"{MAX_LABELS:,} different labels: this column has no labels"
                )
        try:
            self.values.extend([float(cell) if cell else np.nan for cell in row])
        except ValueError:
            self.values.extend([self._cell(number, k, cell) for k, cell in enumerate(row)])

    def texts(self) -> dict[int, tuple[str, ...]]:
        """Return the different texts of each label column by its index."""
        return {column: tuple(places) for column, places in self._texts.items()}

    def _cell(self, number: int, column: int, cell: str) -> float:
        if is_number(cell):
            return float(cell or "nan")
        if column in self._numbers:
            raise WrongUse(
                f"{self._path}, row {number}, column {shorten(self.names[column])}: "
                f"{shorten(cell)!r} is not a number"
            )
        return float("nan")


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, or empty."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True
