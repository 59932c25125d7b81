"""Text tables, read row by row: the memory is that of their numbers, and no line is endless."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from rigctl.config.names import shorten
from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse

MAX_FILE_BYTES = 2**32
MAX_LINE_LETTERS = 1_000_000
MAX_COLUMNS = 10_000


class TextTable(NamedTuple):
    """A table of numbers: ``values`` float64 (n, m), NaN for an empty cell.

    ``first_row``: line of the first values, from 1. ``truncated``: the last line is incomplete
    and left out.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    first_row: int
    truncated: bool


def read_text_table(path: Path, delimiter: str) -> TextTable:
    """Read a table of UTF-8 text; a first row that is no numbers has the names of the columns.

    Raises WrongUse naming file, row and column.
    """
    with open_file(path) as binary:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise WrongUse(f"{path} has more than {MAX_FILE_BYTES:,} bytes: split it")
        with TextIOWrapper(binary, encoding="utf-8-sig", newline="") as file:
            try:
                return _read_rows(path, csv.reader(_lines(path, file), delimiter=delimiter))
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


def _numbered_rows(rows: Iterator[list[str]]) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows with any content and their numbers, cells without spaces around them."""
    for number, row in enumerate(rows, 1):
        if any(row):
            yield number, [cell.strip() for cell in row]


def _read_rows(path: Path, reader: Iterator[list[str]]) -> TextTable:
    rows = _numbered_rows(reader)
    first = next(rows, None)
    if first is None:
        raise WrongUse(f"{path} is empty")
    number, cells = first
    if len(cells) > MAX_COLUMNS:
        raise WrongUse(f"{path}, row {number}: has {len(cells):,} cells; {MAX_COLUMNS:,} at most")
    values = array("d")
    named = not all(_is_number(cell) for cell in cells)
    names = tuple(cells) if named else tuple(str(k) for k in range(1, len(cells) + 1))
    if not named:
        values.extend(_parse_row(path, number, cells, names))
    first_row, truncated = _read_values(path, rows, names, values)
    if not values:
        raise WrongUse(f"{path} has no rows of values")
    table = np.frombuffer(values, np.float64).reshape(-1, len(names))
    return TextTable(names, table, first_row if named else number, truncated)


def _read_values(
    path: Path, rows: Iterator[tuple[int, list[str]]], names: tuple[str, ...], values: array[float]
) -> tuple[int, bool]:
    """Append all rows to ``values``; return the number of the first, and whether the last is cut.

    A row with too few cells is refused unless it is the last one.
    """
    first_row = 0
    for number, cells in rows:
        first_row = first_row or number
        if len(cells) < len(names):
            if next(rows, None) is None:
                return first_row, True
            raise WrongUse(_wrong_length(path, number, cells, names))
        values.extend(_parse_row(path, number, cells, names))
    return first_row, False


def _parse_row(path: Path, number: int, row: list[str], names: tuple[str, ...]) -> list[float]:
    if len(row) != len(names):
        raise WrongUse(_wrong_length(path, number, row, names))
    try:
        return [float(cell) if cell else np.nan for cell in row]
    except ValueError:
        name, cell = next(pair for pair in zip(names, row, strict=True) if not _is_number(pair[1]))
        raise WrongUse(
            f"{path}, row {number}, column {shorten(name)}: {shorten(cell)!r} is not a number"
        ) from None


def _wrong_length(path: Path, number: int, row: list[str], names: tuple[str, ...]) -> str:
    return f"{path}, row {number}: has {len(row)} cells, the first has {len(names)}"


def _is_number(cell: str) -> bool:
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True
