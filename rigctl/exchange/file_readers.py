"""Readers of CSV, TSV, MATLAB .mat (5 and 7.3), NumPy and NWB files as tables of trials."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.analysis.cache import NUMPY_ERRORS
from rigctl.config.text_file import open_file
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap
from rigctl.exchange.matlab import read_mat
from rigctl.exchange.nwb import read_nwb
from rigctl.exchange.recording_files import SUFFIXES
from rigctl.exchange.recording_tables import (
    FileTrials,
    Floats,
    LabelColumn,
    TrialTable,
    format_names,
    range_ends,
    split_trials,
)
from rigctl.exchange.text_table import HEAD_ROWS, TextFormat, first_rows, read_text_table
from rigctl.session.hdf5_file import describe

DELIMITERS = {".csv": ",", ".tsv": "\t", ".txt": "\t", ".lvm": "\t"}
KEPT_BYTES = 512 << 20


class RecordingReader:
    """Reads files as trials; keeps the last files that hold several, up to 512 MiB."""

    def __init__(self, mapping: ImportMap) -> None:
        self._mapping = mapping
        self._kept: OrderedDict[Path, FileTrials] = OrderedDict()

    def read(self, path: Path) -> FileTrials:
        """Return a file's trials. Raises WrongUse naming file, row and column."""
        if path in self._kept:
            self._kept.move_to_end(path)
            return self._kept[path]
        content = read_trials(path, self._mapping)
        if len(content.trials) > 1:
            self._kept[path] = content
            while len(self._kept) > 1 and sum(c.n_bytes for c in self._kept.values()) > KEPT_BYTES:
                self._kept.popitem(last=False)
        return content


def read_trials(path: Path, mapping: ImportMap) -> FileTrials:
    """Read one file by its suffix. Raises WrongUse naming file, row and column."""
    suffix = path.suffix.lower()
    if suffix in DELIMITERS and not mapping.elements:
        return _from_text(path, mapping)
    variables = read_variables(path)
    if mapping.elements:
        return _from_elements(path, variables, mapping)
    if mapping.variable:
        variables = _select_variable(path, variables, mapping.variable)
    return _from_variables(path, str(path), variables, mapping)


def read_variables(path: Path) -> Mapping[str, Any]:
    """Return the variables of a MATLAB, NumPy or NWB file. Raises WrongUse for any other."""
    suffix = path.suffix.lower()
    try:
        if suffix == ".mat":
            return read_mat(path)
        if suffix in (".npy", ".npz"):
            return _read_numpy(path)
        if suffix == ".nwb":
            return read_nwb(path)
    except OSError as error:
        raise WrongUse(f"cannot read {path}: {error.strerror or error}") from error
    if suffix in DELIMITERS:
        raise WrongUse(f"{path} is a text table, which has no elements: correct [trials] elements")
    raise WrongUse(f"{path}: files that can be imported end in {', '.join(SUFFIXES)}")


def _read_numpy(path: Path) -> Mapping[str, Any]:
    """Return the arrays of a file by name; that of a .npy file has an empty name."""
    with open_file(path) as file:
        try:
            loaded = np.load(file, allow_pickle=False)
            return {"": loaded} if isinstance(loaded, np.ndarray) else dict(loaded)
        except NUMPY_ERRORS as error:
            raise WrongUse(
                f"{path} is not a NumPy file of plain numbers, or is damaged: {describe(error)}"
            ) from error


def _from_text(path: Path, mapping: ImportMap) -> FileTrials:
    delimiter = mapping.delimiter or DELIMITERS[path.suffix.lower()]
    form = TextFormat(delimiter, mapping.decimal, mapping.skip_lines, mapping.header)
    try:
        _refuse_one_letter(path, form)
        clocks = [mapping.time_column] if mapping.time_column else []
        table = read_text_table(path, form, mapping.channels, mapping.label_columns, clocks)
    except OSError as error:
        raise WrongUse(f"cannot read {path}: {error.strerror or error}") from error
    if table.clocks and mapping.time_s != 1:
        raise WrongUse(
            f"{path}: {mapping.time_column} has times of day, which are read as seconds: "
            'unit = "s" in [time]'
        )
    whole = TrialTable(path, str(path), table.names, table.values, table.row_numbers)
    keys = [
        LabelColumn(column, *whole.texts_of(column, table.texts))
        for column in mapping.label_columns
    ]
    return split_trials(whole, keys, mapping, table.remarks)


def _refuse_one_letter(path: Path, form: TextFormat) -> None:
    """Raise WrongUse where a letter divides both cells and decimals, unless cells are quoted."""
    if form.delimiter != form.decimal:
        return
    rows = first_rows(path, form, HEAD_ROWS)
    if not any(form.decimal in cell for _, row in rows for cell in row):
        raise WrongUse(
            f"{path}: {form.delimiter!r} divides both cells and decimals: correct delimiter or "
            "decimal in [files]"
        )


def _from_elements(path: Path, variables: Mapping[str, Any], mapping: ImportMap) -> FileTrials:
    """Return the trials of an array of structures or cells."""
    trials: list[TrialTable] = []
    remarks: list[str] = []
    for place, fields in split_elements(path, variables, mapping.elements).items():
        if all(np.size(value) == 0 for value in fields.values()):
            remarks.append(f"{place} is empty: left out")
            continue
        content = _from_variables(path, f"{path}, {place}", fields, mapping)
        trials += content.trials
        remarks += content.remarks
    return FileTrials(tuple(trials), tuple(remarks))


def split_elements(
    path: Path, variables: Mapping[str, Any], wanted: str
) -> dict[str, dict[str, Any]]:
    """Return the fields of each element by ``wanted.number``; a sole element is a structure.

    A cell that is an array has it under an empty name.
    """
    elements: dict[str, dict[str, Any]] = {}
    for name, value in _select_variable(path, variables, wanted).items():
        number, _, rest = name.partition(".")
        if number.isdecimal():
            elements.setdefault(f"{wanted}.{number}", {})[rest] = value
        else:
            elements.setdefault(wanted, {})[name] = value
    return elements


def _from_variables(
    path: Path, place: str, variables: Mapping[str, Any], mapping: ImportMap
) -> FileTrials:
    """Return the trials of the arrays that the map names, labelled by scalars or by columns."""
    labels = {
        column: label_text(variables[column])
        for column in mapping.label_columns
        if column in variables and np.size(variables[column]) == 1
    }
    arrays = {name: value for name, value in variables.items() if name not in labels}
    by_row = [column for column in mapping.label_columns if column not in labels]
    names, columns = _columns_of(place, arrays, (*mapping.channels, *by_row), mapping)
    rows = np.arange(1, len(columns) + 1)
    whole = TrialTable(path, place, names, columns, rows, _named(labels, mapping))
    keys = [LabelColumn(column, *whole.texts_of(column, {})) for column in by_row]
    return split_trials(whole, keys, mapping, ())


def _named(labels: Mapping[str, str], mapping: ImportMap) -> dict[str, str]:
    """Return the texts by label instead of by column."""
    columns = mapping.labels.columns.items()
    return {label: labels[column] for label, column in columns if column in labels}


def label_text(value: Any) -> str:
    """Return the text of a scalar or text variable, whole numbers without a point."""
    item = np.asarray(value).reshape(-1)[0]
    return f"{float(item):.12g}" if isinstance(item, int | float | np.number) else str(item)


def _columns_of(
    place: str, variables: Mapping[str, Any], items: Sequence[str], mapping: ImportMap
) -> tuple[tuple[str, ...], Floats]:
    """Return the names and the columns (n, m) of all that the map names, or of everything."""
    names: list[str] = []
    columns: list[Floats] = []
    for name, value in _mapped_variables(variables, items, mapping.taxels).items():
        for column_name, column in split_columns(place, name, value, mapping.transpose):
            names.append(column_name)
            columns.append(column)
    if not columns or len({len(column) for column in columns}) > 1:
        raise WrongUse(
            f"{place}: its variables {_format_lengths(names, columns)} are not columns of one "
            "length: name one with variable = in [files]"
        )
    return tuple(names), np.stack(columns, axis=1)


def _format_lengths(names: Sequence[str], columns: Sequence[Floats]) -> str:
    """Return one column of each length, with that length."""
    by_length = {len(column): name for name, column in zip(names, columns, strict=True)}
    return format_names(tuple(f"{name} ({n})" for n, name in by_length.items()))


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
            f"{path} has no variable {wanted!r}: it has {format_names(tuple(variables))}"
        )
    return fields


def _mapped_variables(
    variables: Mapping[str, Any], items: Sequence[str], taxels: Sequence[str]
) -> Mapping[str, Any]:
    """Return the variables that a column of the map names, all of them where it names none."""
    ends = {end for item in items for end in (item, *range_ends(item)) if end}
    if any(end.isdigit() for end in ends):
        return variables  # a number counts the columns of all variables
    names = tuple(variables)
    mapped = {name for name in names if any(_is_column_of(name, end) for end in ends)}
    for item in taxels:
        first, last = range_ends(item)
        if first in names and last in names:
            mapped.update(names[names.index(first) : names.index(last) + 1])
    return {name: variables[name] for name in names if name in mapped} or variables


def _is_column_of(name: str, column: str) -> bool:
    """Return whether a column is the variable ``name`` or one of its numbered columns."""
    return column == name or (bool(name) and column.removeprefix(name).isdigit())


def split_columns(place: str, name: str, value: Any, transpose: bool) -> list[tuple[str, Floats]]:
    """Return the columns of an array with their names: those of a table are numbered from 1."""
    array = np.asarray(value)
    if array.dtype.names:
        return [
            (field, _as_floats(place, field, array[field].reshape(-1)))
            for field in array.dtype.names
        ]
    array = _as_floats(place, name, array)
    if array.ndim == 0 or (array.ndim == 2 and 1 in array.shape):
        array = array.reshape(-1)
    if array.ndim == 1:
        return [(name or "1", array)]
    if array.ndim != 2:
        shape = " × ".join(map(str, array.shape))
        raise WrongUse(f"{place}: {name or 'the array'} is {shape}: give samples × columns")
    table = array.T if transpose else array
    return [(f"{name}{k + 1}", np.ascontiguousarray(table[:, k])) for k in range(table.shape[1])]


def _as_floats(place: str, name: str, array: NDArray[Any]) -> Floats:
    if array.dtype.kind in "mM":
        return np.asarray((array - array.reshape(-1)[:1]) / np.timedelta64(1, "s"), np.float64)
    if array.dtype.kind not in "biuf":
        raise WrongUse(f"{place}: {name or 'the array'} {no_numbers(array)}")
    with np.errstate(over="ignore"):  # a long double beyond float64 is infinite, not a reading
        return array.astype(np.float64)


def no_numbers(array: NDArray[Any]) -> str:
    """Return why an array has no numbers and the cure, in words that follow its name."""
    kind = str(array.item()) if array.dtype == object and array.size == 1 else ""
    if kind in ("table", "timetable"):
        return (
            f"is a MATLAB {kind}, which only MATLAB reads: there, S = table2struct(NAME, "
            "'ToScalar', true); save('FILE.mat', '-struct', 'S')"
        )
    if kind in ("string", "datetime", "duration", "categorical"):
        convert = "char(NAME)" if kind in ("string", "categorical") else "seconds(NAME - NAME(1))"
        return f"is a MATLAB {kind}, which only MATLAB reads: there, save {convert} instead"
    return (
        "holds no plain numbers: name arrays of numbers in the map, for example a field as "
        "structure.field"
    )
