"""One file of unknown recordings: its columns, and the texts and scalars beside them."""

from __future__ import annotations

import csv
import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.config.names import shorten
from rigctl.errors import WrongUse
from rigctl.exchange.column_names import format_names, refuse_too_many
from rigctl.exchange.file_readers import (
    DELIMITERS,
    label_text,
    read_variables,
    split_columns,
    split_elements,
)
from rigctl.exchange.recording_files import SUFFIXES
from rigctl.exchange.text_table import (
    HEAD_ROWS,
    TextFormat,
    count_header_rows,
    is_number,
    read_first_lines,
    read_text_table,
)
from rigctl.exchange.trial_tables import Floats, bounded

FIRST_LINES = 30
_LETTERS = (",", ";", "\t", "|", " ")
_DECIMAL_COMMA = re.compile(r"-?\d+,\d+$")
_ELEMENT = re.compile(r"^(?P<array>.+?)\.(?P<number>\d+)(?:\.(?P<field>.*))?$")
MOST_TRANSPOSED = 64


@dataclass(frozen=True, slots=True)
class RecordingSample:
    """The first file of unknown recordings: ``values`` float64 (n, m), NaN for texts.

    ``texts``: the different texts of each text column by its index, whose values are their places.
    ``fields``: texts and scalars of every element by name. ``named``: whether columns have names
    of their own. ``form``: that of a text table. ``elements``: the array whose elements are
    trials; values are those of the first.
    """

    path: Path
    names: tuple[str, ...]
    values: Floats
    named: bool
    texts: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    fields: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    form: TextFormat | None = None
    elements: str = ""
    transpose: bool = False

    def cell(self, row: int, column: int) -> str:
        """Return one cell as text."""
        value = self.values[row, column]
        if not np.isfinite(value):
            return ""
        return self.texts[column][int(value)] if column in self.texts else f"{value:.10g}"

    def different(self, column: int) -> tuple[str, ...]:
        """Return the different texts of a column's cells, in the order of the rows."""
        if column in self.texts:
            return self.texts[column]
        values = self.values[:, column]
        _, rows = np.unique(values, return_index=True)
        return tuple(filter(None, (self.cell(row, column) for row in sorted(rows))))


def read_sample(paths: Sequence[Path]) -> RecordingSample:
    """Return the first file's columns. Raises WrongUse where another has a different layout."""
    first = paths[0]
    other = next((path for path in paths if path.suffix.lower() != first.suffix.lower()), None)
    if other is not None:
        raise WrongUse(
            f"{first.name} and {other.name} are of two kinds: guess a map for each kind of file"
        )
    if first.suffix.lower() in DELIMITERS:
        return _read_text(paths)
    if first.suffix.lower() not in SUFFIXES:
        raise WrongUse(f"{first}: files that can be imported end in {', '.join(SUFFIXES)}")
    return _read_arrays(paths)


def _read_text(paths: Sequence[Path]) -> RecordingSample:
    form = _find_format(paths[0])
    head = _head(paths[0], form)
    for path in paths[1:]:
        if (other := _head(path, form)) != head:
            raise WrongUse(
                f"{path} has {_describe(other)}, but {paths[0].name} has {_describe(head)}: guess "
                "a map for each layout"
            )
    rows = _first_rows(paths[0], form, FIRST_LINES)
    rows = rows[count_header_rows(rows[:HEAD_ROWS]) :]
    columns = [[row[k] for row in rows if k < len(row)] for k in range(head[1])]
    labels = [str(k + 1) for k, cells in enumerate(columns) if _are_labels(cells)]
    table = read_text_table(paths[0], form, (), labels)
    return RecordingSample(
        paths[0], table.names, bounded(table.values), bool(head[0]), table.texts, form=form
    )


def _find_format(path: Path) -> TextFormat:
    """Return the letter between cells, that of decimals, and the lines before the header.

    The letter divides the last of the first lines into the most cells, all into the same number;
    lines before them are skipped.
    """
    lines = read_first_lines(path, FIRST_LINES)
    best = TextFormat(DELIMITERS[path.suffix.lower()])
    most = 1
    for letter in _LETTERS:
        widths = [len(_cells(line, letter)) for _, line in lines]
        width = Counter(widths).most_common(1)[0][0] if widths else 0
        start = next(
            (k for k in range(len(widths)) if set(widths[k:-1] or widths[k:]) == {width}), -1
        )
        if width > most and 0 <= start <= len(lines) / 2:
            skipped = lines[start - 1][0] if start else 0
            best, most = TextFormat(letter, skip_lines=skipped), width
    cells = [cell.strip() for _, line in lines for cell in _cells(line, best.delimiter)]
    has_commas = best.delimiter != "," and any(_DECIMAL_COMMA.match(cell) for cell in cells)
    return best._replace(decimal=",") if has_commas else best


def _first_rows(path: Path, form: TextFormat, count: int) -> list[list[str]]:
    lines = read_first_lines(path, count, form.skip_lines)
    return [form.cells(_cells(line, form.delimiter)) for _, line in lines]


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line, the whole line where this letter leaves too long a cell."""
    try:
        return next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:
        return [line]


def _head(path: Path, form: TextFormat) -> tuple[tuple[str, ...], int]:
    """Return the names in a table's header, none without one, and its number of columns."""
    rows = _first_rows(path, form, HEAD_ROWS)
    if not rows:
        raise WrongUse(f"{path} is empty")
    refuse_too_many(path, len(rows[0]))
    return tuple(rows[0]) if count_header_rows(rows) else (), len(rows[0])


def _describe(head: tuple[tuple[str, ...], int]) -> str:
    names, count = head
    shown = format_names(names[:6]) + (", …" if len(names) > 6 else "")
    return f"the columns {shown} ({count})" if names else f"{count} columns without names"


def _are_labels(cells: Sequence[str]) -> bool:
    """Return whether a column has texts that repeat, so that they may be labels."""
    is_text = any(not is_number(cell) for cell in cells)
    return is_text and (len(cells) < 4 or len(set(cells)) <= len(cells) / 2)


def _read_arrays(paths: Sequence[Path]) -> RecordingSample:
    variables = read_variables(paths[0])
    if len(paths) > 1:
        _refuse_other_variables(paths, variables)
    elements = _find_elements(paths[0], variables)
    trials = split_elements(paths[0], variables, elements) if elements else {"": dict(variables)}
    full = [trial for trial in trials.values() if any(np.size(value) for value in trial.values())]
    fields: dict[str, list[str]] = defaultdict(list)
    for trial in full:
        for name, value in trial.items():
            if np.size(value) == 1 and np.asarray(value).dtype.kind in "biufUS":
                fields[name].append(label_text(value))
    names, values, transpose = _table(paths[0], full[0] if full else {}, fields)
    texts = {name: tuple(found) for name, found in fields.items()}
    named = not all(name.isdigit() for name in names)
    return RecordingSample(
        paths[0],
        names,
        bounded(values),
        named,
        fields=texts,
        elements=elements,
        transpose=transpose,
    )


def _refuse_other_variables(paths: Sequence[Path], variables: Mapping[str, Any]) -> None:
    """Raise WrongUse where the last file has other names than the first."""
    last = read_variables(paths[-1])
    ours, theirs = (
        {re.sub(r"\.\d+\b", ".n", name) for name in found} for found in (variables, last)
    )
    if ours != theirs:
        other = shorten(min(theirs ^ ours))
        raise WrongUse(
            f"{paths[0].name} and {paths[-1].name} have different variables, such as {other}: "
            "guess a map for each layout"
        )


def _find_elements(path: Path, variables: Mapping[str, Any]) -> str:
    """Return the array of structures or cells whose elements look alike, the largest of these."""
    arrays: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, value in variables.items():
        if match := _ELEMENT.match(name):
            arrays[match["array"]][name] = value
    for array in sorted(arrays, key=lambda array: _size(arrays[array]), reverse=True):
        elements = [e for e in split_elements(path, arrays[array], array).values() if _size(e)]
        if len(elements) > 1 and len({_signature(element) for element in elements}) == 1:
            return array
    return ""


def _size(element: Mapping[str, Any]) -> int:
    return sum(int(np.size(value)) for value in element.values())


def _signature(element: Mapping[str, Any]) -> frozenset[tuple[str, int]]:
    """Return the names of the fields with the smaller size of each: the number of columns."""
    return frozenset(
        (name, min(np.shape(value)) if np.ndim(value) == 2 else 0)
        for name, value in element.items()
    )


def _table(
    path: Path, trial: Mapping[str, Any], fields: Mapping[str, Sequence[str]]
) -> tuple[tuple[str, ...], Floats, bool]:
    """Return names and values of the columns of the most common length, and whether transposed."""
    arrays = {
        name: np.asarray(value)
        for name, value in trial.items()
        if name not in fields
        and np.ndim(value) in (1, 2)
        and np.asarray(value).dtype.kind in "biufV"
    }
    transpose = any(
        array.ndim == 2 and 1 < array.shape[0] <= MOST_TRANSPOSED < array.shape[1]
        for array in arrays.values()
    )
    columns = [
        pair
        for name, array in arrays.items()
        for pair in split_columns(str(path), name, array, transpose)
    ]
    if not columns:
        raise WrongUse(f"{path}: no variable is a table of numbers, with samples along rows")
    refuse_too_many(path, len(columns))
    length = Counter(len(column) for _, column in columns).most_common(1)[0][0]
    chosen = [(name, column) for name, column in columns if len(column) == length]
    return tuple(name for name, _ in chosen), np.stack([c for _, c in chosen], axis=1), transpose
