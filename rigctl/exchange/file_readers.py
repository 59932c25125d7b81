"""Foreign files to columns of numbers: CSV, TSV, MATLAB .mat (5 and 7.3), NumPy .npy and .npz."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.exchange.matlab_reader import read_mat

Floats = NDArray[np.float64]
_DELIMITERS = {".csv": ",", ".tsv": "\t", ".txt": "\t"}
RANGE = ".."


@dataclass(frozen=True, slots=True)
class FileColumns:
    """One file: ``values`` float64 (n, m), NaN where a cell is empty; a name for each column.

    ``first_row`` is what people call the first row of values; ``cut_short`` tells that the last
    row was not whole and is left out.
    """

    path: Path
    names: tuple[str, ...]
    values: Floats
    first_row: int = 1
    cut_short: bool = False

    def places(self, wanted: Iterable[str]) -> list[int]:
        """Places of named, numbered or ranged columns. Raises WrongUse for one not there."""
        return [place for item in wanted for place in self._range(item)]

    def _range(self, item: str) -> range:
        first, dots, last = item.partition(RANGE)
        if item in self.names or not dots:
            place = self._place(item)
            return range(place, place + 1)
        start, stop = self._place(first.strip()), self._place(last.strip())
        if stop < start:
            raise WrongUse(f"{self.path}: column range {item} runs backwards: turn it round")
        return range(start, stop + 1)

    def _place(self, name: str) -> int:
        if name in self.names:
            return self.names.index(name)
        if name.isdigit() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        close = difflib.get_close_matches(name, self.names, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"it has {_listed(self.names)}"
        raise WrongUse(f"{self.path} has no column {name!r}: {hint}")


def read_columns(path: Path, mapping: ImportMap) -> FileColumns:
    """Read one file by its ending. Raises WrongUse naming file, row and column."""
    ending = path.suffix.lower()
    try:
        if ending in _DELIMITERS:
            return _read_text(path, mapping.delimiter or _DELIMITERS[ending])
        if ending == ".mat":
            return _from_variables(path, read_mat(path), mapping)
        if ending in (".npy", ".npz"):
            return _from_variables(path, _numpy(path), mapping)
    except OSError as error:
        raise WrongUse(f"cannot read {path}: {error.strerror or error}") from error
    known = ", ".join([*_DELIMITERS, ".mat", ".npy", ".npz"])
    raise WrongUse(f"{path}: files that can be imported end in {known}")


def _read_text(path: Path, delimiter: str) -> FileColumns:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [
                (number, row) for number, row in enumerate(csv.reader(file, delimiter=delimiter), 1)
            ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise WrongUse(f"{path} is not a text table in UTF-8: {error}") from error
    rows = [(number, [cell.strip() for cell in row]) for number, row in rows if any(row)]
    if not rows:
        raise WrongUse(f"{path} is empty")
    header = rows[0][1]
    named = not all(_is_number(cell) for cell in header)
    names = tuple(header) if named else tuple(str(k) for k in range(1, len(header) + 1))
    body = rows[1:] if named else rows
    cut_short = bool(body) and len(body[-1][1]) < len(names)
    body = body[:-1] if cut_short else body
    if not body:
        raise WrongUse(f"{path} has no rows of values")
    values = np.array([_numbers(path, number, row, names) for number, row in body])
    return FileColumns(path, names, values, body[0][0], cut_short)


def _numbers(path: Path, number: int, row: list[str], names: tuple[str, ...]) -> list[float]:
    if len(row) != len(names):
        raise WrongUse(f"{path}, row {number}: has {len(row)} cells, the first has {len(names)}")
    try:
        return [float(cell) if cell else np.nan for cell in row]
    except ValueError:
        name, cell = next(pair for pair in zip(names, row, strict=True) if not _is_number(pair[1]))
        raise WrongUse(f"{path}, row {number}, column {name}: {cell!r} is not a number") from None


def _is_number(cell: str) -> bool:
    try:
        float(cell or "nan")
    except ValueError:
        return False
    return True


def _numpy(path: Path) -> dict[str, Any]:
    try:
        loaded = np.load(path, allow_pickle=False)
        if isinstance(loaded, np.ndarray):
            return {"": loaded}
        with loaded:
            return {name: loaded[name] for name in loaded.files}
    except (ValueError, EOFError) as error:
        raise WrongUse(
            f"{path} is no NumPy file of plain numbers, or is damaged: {error}"
        ) from error


def _from_variables(path: Path, variables: Mapping[str, Any], mapping: ImportMap) -> FileColumns:
    """One chosen variable or structure, or all that the map names, as columns of one length."""
    chosen = _chosen(path, variables, mapping.variable) if mapping.variable else variables
    names: list[str] = []
    columns: list[Floats] = []
    for name, value in _asked_for(chosen, mapping).items():
        for own, column in _columns_of(path, name, value, mapping.transpose):
            names.append(own)
            columns.append(column)
    if not columns or len({len(column) for column in columns}) > 1:
        raise WrongUse(
            f"{path}: its variables {_lengths(names, columns)} are not columns of one length: "
            "name one with variable = in [files]"
        )
    return FileColumns(path, tuple(names), np.stack(columns, axis=1))


def _lengths(names: Sequence[str], columns: Sequence[Floats]) -> str:
    """Columns with their lengths, one of each length."""
    by_length = {len(column): name for name, column in zip(names, columns, strict=True)}
    return _listed(tuple(f"{name} ({n})" for n, name in by_length.items()))


def _chosen(path: Path, variables: Mapping[str, Any], wanted: str) -> dict[str, Any]:
    """The variable of that name, or the fields of the structure of that name."""
    if wanted in variables:
        return {"": variables[wanted]}
    start = f"{wanted}."
    fields = {
        name.removeprefix(start): value
        for name, value in variables.items()
        if name.startswith(start)
    }
    if not fields:
        raise WrongUse(f"{path} has no variable {wanted!r}: it has {_listed(tuple(variables))}")
    return fields


def _asked_for(variables: Mapping[str, Any], mapping: ImportMap) -> Mapping[str, Any]:
    """Variables that a column of the map names; all of them where it names none."""
    wanted = (*mapping.taxels, mapping.time_column, mapping.loadcell, *mapping.extra)
    ends = {end.strip() for item in wanted for end in (item, *item.split(RANGE)) if end.strip()}

    if any(end.isdigit() for end in ends):
        return variables  # numbers count the columns of all of them

    def named(name: str) -> bool:
        return name in ends or any(
            end.startswith(name) and end[len(name) :].isdigit() for end in ends if name
        )

    between = _between(tuple(variables), mapping.taxels)
    found = {n: value for n, value in variables.items() if n in between or named(n)}
    return found or variables


def _between(names: tuple[str, ...], items: tuple[str, ...]) -> set[str]:
    """Variables that stand between the ends of a range."""
    inside: set[str] = set()
    for item in items:
        first, dots, last = (part.strip() for part in item.partition(RANGE))
        if dots and first in names and last in names:
            inside |= set(names[names.index(first) : names.index(last) + 1])
    return inside


def _columns_of(path: Path, name: str, value: Any, transpose: bool) -> list[tuple[str, Floats]]:
    array = np.asarray(value)
    if array.dtype.names:
        return [
            (field, _plain(path, field, array[field].reshape(-1))) for field in array.dtype.names
        ]
    array = _plain(path, name, array)
    if array.ndim == 0 or (array.ndim == 2 and 1 in array.shape):
        array = array.reshape(-1)
    if array.ndim == 1:
        return [(name or "1", array)]
    if array.ndim != 2:
        shape = " × ".join(map(str, array.shape))
        raise WrongUse(f"{path}: {name or 'the array'} is {shape}: give samples × columns")
    table = array.T if transpose else array
    return [(f"{name}{k + 1}", np.ascontiguousarray(table[:, k])) for k in range(table.shape[1])]


def _plain(path: Path, name: str, array: NDArray[Any]) -> Floats:
    if array.dtype.kind not in "biuf":
        raise WrongUse(
            f"{path}: {name or 'the array'} holds no plain numbers: name arrays of numbers in the "
            "map, such as a field of a structure by structure.field"
        )
    return array.astype(np.float64)


def _listed(names: tuple[str, ...], most: int = 12) -> str:
    shown = ", ".join(names[:most])
    return f"{shown}, … ({len(names)})" if len(names) > most else shown or "none"
