"""Text tables, read in chunks by pandas: the memory is that of their numbers."""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import islice, repeat
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, NoReturn, TextIO

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import SAVE_AS_UTF8, open_file, shorten, text_encoding
from rigctl.errors import WrongUse
from rigctl.exchange.recording_tables import find_columns, refuse_too_many

if TYPE_CHECKING:
    import pandas

MAX_FILE_BYTES = 2**32
MAX_LINE_LETTERS = 1_000_000
HEAD_ROWS = 3
CHUNK_CELLS = 1_000_000
NumberedRow = tuple[int, list[str]]


class TextFormat(NamedTuple):
    """What divides cells and decimals, and how many lines stand before the header.

    ``header``: whether the first row behind them has names, None to tell by its cells.
    """

    delimiter: str
    decimal: str = "."
    skip_lines: int = 0
    header: bool | None = None


class TextTable(NamedTuple):
    """A table of numbers: ``values`` float64 (n, m), NaN for an empty cell.

    ``row_numbers``: int64 (n,), the line of each row, from 1. ``remarks``: what was left out or
    taken for a header, in words. ``texts``: the different texts of each label column by its index;
    ``values`` then has the place of a row's text among them, from 0. ``clocks``: the columns whose
    times of day were read as seconds.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    row_numbers: NDArray[np.int64]
    remarks: tuple[str, ...]
    texts: dict[int, tuple[str, ...]]
    clocks: frozenset[int]


CLOCK = re.compile(
    r"(?:(?P<date>\d[\d./-]{5,9})[ T])?(?P<hours>\d{1,2}):(?P<minutes>\d{2}):"
    r"(?P<seconds>\d{2}(?:[.,]\d+)?) ?(?P<half>[AP]M)?(?:Z|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
"""A time of day or a date with one, as ISO 8601 or people write it."""
DAY_S = 86_400.0


def read_text_table(
    path: Path,
    form: TextFormat,
    numbers: Sequence[str] | None = None,
    labels: Sequence[str] = (),
    clocks: Sequence[str] = (),
) -> TextTable:
    """Read a table of text; a first row that is no numbers has the names of the columns.

    So has one that counts the columns, as pandas writes them without names, unless the format says
    otherwise. A second row without numbers has their units and is left out. Rows may end in a
    delimiter that the names do not have, and names in a column that no row has. Lines that begin
    with #, % or // are comments; lines without a number at the end are a footer.

    ``numbers``: the columns that must be numbers, None for all; others are NaN where they are
    texts. ``labels``: columns that may be texts. ``clocks``: columns that may have times of day,
    which become seconds. Raises WrongUse naming file, row and column.
    """
    head = first_rows(path, form, HEAD_ROWS)
    if not head:
        raise WrongUse(f"{path} is empty")
    number, cells = head[0]
    refuse_too_many(f"{path}, row {number}", len(cells))
    rows = [row for _, row in head]
    n_header = count_header_rows(rows, form)
    names = column_names(rows, n_header)
    before = head[n_header - 1][0] if n_header else form.skip_lines
    columns = _Columns(path, names, form, numbers, labels, clocks)
    if n_header and _counts_columns(cells) and form.header is None:
        shown = f"{', '.join(cells[:2])}, …, {cells[-1]}"
        columns.remarks.append(
            f"its first row {shown} counts the columns, so it is a header: header = false in "
            "[files] takes it for values"
        )
    if any(len(row) > len(names) for _, row in head[n_header:]):
        columns.check_lengths(before)
    columns.read(before)
    if not columns.values:
        raise WrongUse(f"{path} has no rows of values")
    return columns.table()


def column_names(rows: Sequence[Sequence[str]], n_header: int) -> tuple[str, ...]:
    """Return the names of the columns from the first rows; numbers from 1 where there are none.

    A first column without a name that counts the rows is the index that pandas writes.
    """
    cells, below = rows[0], rows[n_header:]
    if len(below) > 1 and all(len(row) == len(cells) - 1 for row in below):
        cells = cells[:-1]  # LabVIEW names a column of comments that its rows leave out
    if not n_header:
        return tuple(str(k) for k in range(1, len(cells) + 1))
    names = [str(k) for k in range(1, len(cells) + 1)] if _counts_columns(cells) else list(cells)
    counted = [row[0] for row in below]
    is_index = not cells[0] and counted in (["0", "1"], ["1", "2"])
    return ("index" if is_index else names[0], *names[1:])


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
        try:
            start = binary.peek(_FIRST_BYTES)
            encoding = text_encoding(start)
            with TextIOWrapper(binary, encoding=encoding, newline="") as file:
                yield file
        except UnicodeDecodeError as error:
            raise WrongUse(f"{path} is {_what_it_is(start, error)}") from error
        except csv.Error as error:
            raise WrongUse(f"{path} is not a text table in UTF-8: {error}") from error


_FIRST_BYTES = 64
_OTHER_KINDS = {
    b"PK\x03\x04": "an Excel workbook or a ZIP archive: save its sheet as CSV, or unpack it",
    b"\xd0\xcf\x11\xe0": "an Excel workbook: save its sheet as CSV",
    b"\x1f\x8b": "compressed by gzip: unpack it",
}


def _what_it_is(start: bytes, error: UnicodeDecodeError) -> str:
    """Return what a file is that is no text in UTF-8, and the cure."""
    for signature, kind in _OTHER_KINDS.items():
        if start.startswith(signature):
            return kind
    return f"not a text table in UTF-8: {SAVE_AS_UTF8} ({error})"


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


def _rows(path: Path, file: TextIO, form: TextFormat, width: int = 0) -> Iterator[NumberedRow]:
    """Yield the rows with any content, cells without spaces around them.

    With a ``width``, lines that are comments have none.
    """
    lines: Iterable[str] = islice(_lines(path, file), form.skip_lines, None)
    if width:
        lines = (_blank_comments(line, form, width)[0] for line in lines)
    rows = csv.reader(lines, delimiter=form.delimiter)
    for row in rows:
        if any(row):
            yield form.skip_lines + rows.line_num, [cell.strip() for cell in row]


def count_header_rows(rows: Sequence[Sequence[str]], form: TextFormat) -> int:
    """Return how many of the first three rows are a header: names, and units below them."""
    if form.header is False or not rows:
        return 0
    if form.header or _counts_columns(rows[0]):
        return 1
    rows = [[cell.replace(form.decimal, ".") for cell in row] for row in rows]
    is_text = len(rows) == HEAD_ROWS and not any(cell and is_number(cell) for cell in rows[1])
    if is_text and _has_names(rows[1], rows[2]) and _has_names(rows[0], rows[2]):
        return 2
    return int(_has_names(rows[0], rows[1] if len(rows) > 1 else ()))


def _has_names(first: Sequence[str], second: Sequence[str]) -> bool:
    """Return whether a first row has names: a text where the second has a number, or no cell."""
    below = (*second, *repeat("", len(first) - len(second)))
    return any(
        not is_number(cell) and is_number(under) for cell, under in zip(first, below, strict=False)
    )


FEWEST_COUNTED = 3
"""Two columns may well begin with 0 and 1: the time, and a reading."""


def _counts_columns(cells: Sequence[str]) -> bool:
    """Return whether cells are 0, 1, 2 … or 1, 2, 3 …, one without a text before them or none."""
    counted = list(cells[1:] if cells and not cells[0] else cells)
    n = len(counted)
    in_order = (list(map(str, range(n))), list(map(str, range(1, n + 1))))
    return n >= FEWEST_COUNTED and counted in in_order


class _Uncommented:
    """A text in which lines that are comments are empty; ``count``: how many there were."""

    def __init__(self, file: TextIO, form: TextFormat, width: int) -> None:
        self._file, self._form, self._width = file, form, width
        self.count = 0

    def read(self, size: int = -1) -> str:
        """Return the next letters up to the end of a line."""
        text = self._file.read(size)
        return self._blank(text + self._file.readline() if size > 0 else text)

    def readline(self) -> str:
        """Return the next line."""
        return self._blank(self._file.readline())

    def __iter__(self) -> Iterator[str]:
        """Yield the lines."""
        return iter(self.readline, "")

    def _blank(self, text: str) -> str:
        text, count = _blank_comments(text, self._form, self._width)
        self.count += count
        return text


def _blank_comments(text: str, form: TextFormat, width: int) -> tuple[str, int]:
    """Return a text without its lines that are comments, and how many there were.

    A comment has another number of cells than a row: a row may begin with the label ``#3``.
    """
    if not any(mark in text for mark in COMMENT_MARKS):
        return text, 0
    comments = [
        line[0]
        for line in _COMMENT.finditer(text)
        if line[0].count(form.delimiter) + 1 not in (width, width + 1)
    ]
    for comment in comments:
        text = text.replace(comment, "", 1)
    return text, len(comments)


COMMENT_MARKS = ("#", "%", "//")
_COMMENT = re.compile(rf"^[ \t]*(?:{'|'.join(COMMENT_MARKS)}).*$", re.MULTILINE)


class _Columns:
    """Collects the numbers of a table; texts of label columns become their place."""

    def __init__(
        self,
        path: Path,
        names: tuple[str, ...],
        form: TextFormat,
        numbers: Sequence[str] | None,
        labels: Sequence[str],
        clocks: Sequence[str],
    ) -> None:
        self.values = array("d")
        self.remarks: list[str] = []
        self._path, self._names, self._form = path, names, form
        self._lines = array("q")
        self._left_out: set[int] | None = None
        self._clocks = {*find_columns(path, names, clocks)}
        self._read_clocks: set[int] = set()
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
            uncommented = _Uncommented(file, self._form, width)
            try:
                with pandas.read_csv(
                    uncommented,
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
        if uncommented.count:
            self.remarks.append(f"{uncommented.count} lines are comments: left out")

    def table(self) -> TextTable:
        """Return what was read."""
        values = np.frombuffer(self.values, np.float64).reshape(-1, len(self._names))
        texts = {column: tuple(places) for column, places in self._texts.items()}
        lines = np.frombuffer(self._lines, np.int64)
        clocks = frozenset(self._read_clocks)
        return TextTable(self._names, values, lines, tuple(self.remarks), texts, clocks)

    def _add(self, rows: pandas.DataFrame, n_before: int) -> None:
        width = len(self._names)
        # pandas fills short rows: only their cells tell them from rows that end in empty ones.
        if rows[width - 1].isna().any() or rows[width].notna().any():
            rows = rows[~rows.index.isin(self.check_lengths(n_before))]
        columns = [self._column(column, rows[column]) for column in range(width)]
        self.values.frombytes(np.stack(columns, axis=1).tobytes())
        self._lines.frombytes(rows.index.to_numpy(np.int64).tobytes())

    def check_lengths(self, n_before: int) -> Collection[int]:
        """Return the lines at the end that are no rows: a footer, or one row that is cut.

        Raises WrongUse for another row with too few or many cells. One empty cell may follow the
        last column.
        """
        if self._left_out is None:
            at_end = self._rows_at_end(n_before)
            is_footer = not any(any(map(is_number, filter(None, row))) for row in at_end.values())
            if len(at_end) > 1 and not is_footer:
                self._refuse_length(*next(iter(at_end.items())))
            if is_footer and at_end:
                self.remarks.append(f"{len(at_end)} lines at its end have no numbers: left out")
            elif at_end:
                self._refuse_long(*next(iter(at_end.items())))
                self.remarks.append("its last row is incomplete: left out")
            self._left_out = set(at_end)
        return self._left_out

    def _rows_at_end(self, n_before: int) -> dict[int, list[str]]:
        """Return the cells of the last rows that have another number of cells, by their lines."""
        width = len(self._names)
        wrong: dict[int, list[str]] = {}
        with open_text(self._path) as file:
            form = self._form._replace(skip_lines=n_before)
            for number, cells in _rows(self._path, file, form, width):
                if len(cells) >= width and cells[width:] in ([], [""]):
                    if wrong:
                        self._refuse_length(*next(iter(wrong.items())))
                else:
                    wrong[number] = cells
        return wrong

    def _refuse_long(self, number: int, cells: Sequence[str]) -> None:
        if len(cells) > len(self._names):
            self._refuse_length(number, cells)

    def _refuse_length(self, number: int, cells: Sequence[str]) -> NoReturn:
        raise WrongUse(
            f"{self._path}, row {number}: has {len(cells)} cells, the first has {len(self._names)}"
        )

    def _column(self, column: int, cells: pandas.Series) -> NDArray[np.float64]:
        if cells.dtype.kind in "iuf":
            return np.asarray(cells, np.float64)
        if column in self._clocks and (seconds := clock_seconds(cells)) is not None:
            self._read_clocks.add(column)
            return seconds
        parse = self._place if column in self._texts else self._number
        pairs = zip(cells.index, cells.astype(object), strict=True)
        return np.array([parse(n, column, str(c).strip()) if c == c else np.nan for n, c in pairs])

    def _place(self, line: int, column: int, text: str) -> float:
        """Return the place of a label's text among the different ones of its column."""
        places = self._texts[column]
        return places.setdefault(text, len(places)) if text else np.nan

    def _number(self, line: int, column: int, cell: str) -> float:
        number = cell.replace(self._form.decimal, ".")
        if is_number(number) and not is_grouped(cell, self._form.decimal):
            return float(number or "nan")
        if column in self._clocks and CLOCK.fullmatch(cell):
            return np.nan  # another cell of its column is neither, and is named
        if column in self._numbers or cell == self._names[column]:
            raise WrongUse(
                f"{self._path}, row {line}, column {shorten(self._names[column])}: "
                f"{shorten(cell)!r} {self._why_no_number(column, cell)}"
            )
        return np.nan

    def _why_no_number(self, column: int, cell: str) -> str:
        if cell == self._names[column]:
            return "is the header again: the file has several recordings, split it there"
        if is_grouped(cell, self._form.decimal):
            return (
                f"has separators of thousands beside decimals with {self._form.decimal!r}: "
                "save the table without them, or correct decimal in [files]"
            )
        return "is not a number"


def clock_seconds(cells: pandas.Series) -> NDArray[np.float64] | None:
    """Return times of day as seconds, float64 (n,), NaN for empty cells; None if they are none.

    Another date is another day, and so is a time of day that falls by more than twelve hours.
    """
    import pandas

    parts = cells.str.strip().str.extract(f"^{CLOCK.pattern}$", CLOCK.flags)
    if parts["hours"][cells.notna()].isna().any():
        return None
    hours, minutes = (pandas.to_numeric(parts[name]) for name in ("hours", "minutes"))
    seconds = pandas.to_numeric(parts["seconds"].str.replace(",", "."))
    half = parts["half"].str.upper()
    hours = hours.where(half.isna(), hours % 12 + 12 * (half == "PM"))
    of_day = (hours * 3600 + minutes * 60 + seconds).to_numpy(np.float64)
    days = pandas.factorize(parts["date"])[0].astype(np.float64)
    if (days < 0).all():  # no date: only midnight begins another day
        falls = np.diff(pandas.Series(of_day).ffill(), prepend=of_day[:1]) < -DAY_S / 2
        days = np.cumsum(falls).astype(np.float64)
    return np.asarray(of_day + days * DAY_S)


def is_grouped(cell: str, decimal: str) -> bool:
    """Return whether a number has groups of thousands: 1,234.5 with decimal points.

    With decimal commas 1.234 is another number than with points, so it is no number as it is.
    """
    return bool(_GROUPED[decimal].fullmatch(cell))


_GROUPED = {
    decimal: re.compile(rf"[-+]?\d{{1,3}}(?:[{groups}'’\s]\d{{3}})+(?:{re.escape(decimal)}\d*)?")
    for decimal, groups in ((".", ","), (",", "."))
}


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, or empty."""
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True
