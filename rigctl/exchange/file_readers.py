"""Readers of CSV, TSV, MATLAB .mat (5 and 7.3), NumPy .npy and .npz files as columns of numbers."""

from __future__ import annotations

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
from rigctl.exchange.text_table import MAX_COLUMNS, read_text_table
from rigctl.session.files.numpy_file import read_numpy

Floats = NDArray[np.float64]
_DELIMITERS = {".csv": ",", ".tsv": "\t", ".txt": "\t"}
RANGE = ".."
MAX_SHOWN = 12


@dataclass(frozen=True, slots=True)
class FileColumns:
    """One file: ``values`` float64 (n, m), NaN for an empty cell, with the names of its columns.

    ``first_row``: line number of the first row of values, from 1; ``truncated``: the last row is
    incomplete and left out.
    """

    path: Path
    names: tuple[str, ...]
    values: Floats
    first_row: int = 1
    truncated: bool = False

    def indices(self, items: Iterable[str]) -> list[int]:
        """Return the indices of names, numbers or ranges. Raises WrongUse for a missing column."""
        found: list[int] = []
        for item in items:
            found += self._range(item)
            if len(found) > MAX_COLUMNS:
                raise WrongUse(f"{self.path}: more than {MAX_COLUMNS:,} columns are mapped")
        return found

    def _range(self, item: str) -> range:
        first, dots, last = item.partition(RANGE)
        if item in self.names or not dots:
            index = self._index(item)
            return range(index, index + 1)
        start, stop = self._index(first.strip()), self._index(last.strip())
        if stop < start:
            raise WrongUse(f"{self.path}: column range {item} runs backwards: swap its ends")
        return range(start, stop + 1)

    def _index(self, name: str) -> int:
        if name in self.names:
            return self.names.index(name)
        if name.isdecimal() and 1 <= int(name) <= len(self.names):
            return int(name) - 1
        close = difflib.get_close_matches(name, self.names, 1)
        hint = f"did you mean {close[0]!r}?" if close else f"it has {_format_names(self.names)}"
        raise WrongUse(f"{self.path} has no column {name!r}: {hint}")


def read_columns(path: Path, mapping: ImportMap) -> FileColumns:
    """Read one file by its suffix. Raises WrongUse naming file, row and column."""
    suffix = path.suffix.lower()
    try:
        if suffix in _DELIMITERS:
            table = read_text_table(path, mapping.delimiter or _DELIMITERS[suffix])
            return FileColumns(path, *table)
        if suffix == ".mat":
            return _from_variables(path, read_mat(path), mapping)
        if suffix in (".npy", ".npz"):
            return _from_variables(path, read_numpy(path), mapping)
    except OSError as error:
        raise WrongUse(f"cannot read {path}: {error.strerror or error}") from error
    suffixes = ", ".join([*_DELIMITERS, ".mat", ".npy", ".npz"])
    raise WrongUse(f"{path}: files that can be imported end in {suffixes}")


def _from_variables(path: Path, variables: Mapping[str, Any], mapping: ImportMap) -> FileColumns:
    """Return the map's variable or structure, or all that the map names, as columns."""
    if mapping.variable:
        variables = _select_variable(path, variables, mapping.variable)
    names: list[str] = []
    columns: list[Floats] = []
    for name, value in _mapped_variables(variables, mapping).items():
        for column_name, column in _split_columns(path, name, value, mapping.transpose):
            names.append(column_name)
            columns.append(column)
    if not columns or len({len(column) for column in columns}) > 1:
        raise WrongUse(
            f"{path}: its variables {_format_lengths(names, columns)} are not columns of one "
            "length: name one with variable = in [files]"
        )
    return FileColumns(path, tuple(names), np.stack(columns, axis=1))


def _format_lengths(names: Sequence[str], columns: Sequence[Floats]) -> str:
    """Return one column of each length, with that length."""
    by_length = {len(column): name for name, column in zip(names, columns, strict=True)}
    return _format_names(tuple(f"{name} ({n})" for n, name in by_length.items()))


def _select_variable(path: Path, variables: Mapping[str, Any], wanted: str) -> dict[str, Any]:
    """Return the variable of a name, or the fields of the structure of that name."""
    if wanted in variables:
        return {"": variables[wanted]}
    prefix = f"{wanted}."
    fields = {
        name.removeprefix(prefix): value
        for name, value in variables.items()
        if name.startswith(prefix)
    }
    if not fields:
        raise WrongUse(
            f"{path} has no variable {wanted!r}: it has {_format_names(tuple(variables))}"
        )
    return fields


def _mapped_variables(variables: Mapping[str, Any], mapping: ImportMap) -> Mapping[str, Any]:
    """Return the variables that a column of the map names, all of them where it names none."""
    items = (*mapping.taxels, mapping.time_column, mapping.loadcell, *mapping.extra)
    ends = {end.strip() for item in items for end in (item, *item.split(RANGE)) if end.strip()}
    if any(end.isdigit() for end in ends):
        return variables  # a number counts the columns of all variables
    names = tuple(variables)
    mapped = {name for name in names if any(_is_column_of(name, end) for end in ends)}
    for item in mapping.taxels:
        first, _, last = (part.strip() for part in item.partition(RANGE))
        if first in names and last in names:
            mapped.update(names[names.index(first) : names.index(last) + 1])
    return {name: variables[name] for name in names if name in mapped} or variables


def _is_column_of(name: str, column: str) -> bool:
    """Return whether a column is the variable ``name`` or one of its numbered columns."""
    return column == name or (bool(name) and column.removeprefix(name).isdigit())


def _split_columns(path: Path, name: str, value: Any, transpose: bool) -> list[tuple[str, Floats]]:
    array = np.asarray(value)
    if array.dtype.names:
        return [
            (field, _as_floats(path, field, array[field].reshape(-1)))
            for field in array.dtype.names
        ]
    array = _as_floats(path, name, array)
    if array.ndim == 0 or (array.ndim == 2 and 1 in array.shape):
        array = array.reshape(-1)
    if array.ndim == 1:
        return [(name or "1", array)]
    if array.ndim != 2:
        shape = " × ".join(map(str, array.shape))
        raise WrongUse(f"{path}: {name or 'the array'} is {shape}: give samples × columns")
    table = array.T if transpose else array
    return [(f"{name}{k + 1}", np.ascontiguousarray(table[:, k])) for k in range(table.shape[1])]


def _as_floats(path: Path, name: str, array: NDArray[Any]) -> Floats:
    if array.dtype.kind not in "biuf":
        raise WrongUse(
            f"{path}: {name or 'the array'} holds no plain numbers: name arrays of numbers in the "
            "map, for example a field as structure.field"
        )
    return array.astype(np.float64)


def _format_names(names: tuple[str, ...]) -> str:
    shown = ", ".join(names[:MAX_SHOWN])
    return f"{shown}, … ({len(names)})" if len(names) > MAX_SHOWN else shown or "none"
