"""Tables of recordings: names of their columns, and the trials that their rows are cut into."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.config.text_file import shorten
from rigctl.errors import WrongUse
from rigctl.exchange.column_map import ImportMap

RANGE = ".."
MAX_COLUMNS = 10_000
MAX_SHOWN, SHOWN_LETTERS = 12, 40
MOST_COMPARED, COMPARED_LETTERS = 1000, 100


def find_columns(place: object, names: Sequence[str], items: Iterable[str]) -> list[int]:
    """Return the indices of names, numbers from 1 or ranges of either.

    ``place`` names the file or trial in messages. Raises WrongUse for a missing column.
    """
    columns = _Columns(place, names)
    found: list[int] = []
    for item in items:
        found += columns.find_range(item)
        if len(found) > MAX_COLUMNS:
            raise WrongUse(f"{place}: more than {MAX_COLUMNS:,} columns are mapped")
    return found


def range_ends(item: str) -> tuple[str, str]:
    """Return the two ends of a range, twice the same for a single column."""
    first, dots, last = item.partition(RANGE)
    return (first.strip(), last.strip()) if dots else (item, item)


def refuse_too_many(place: object, count: int) -> None:
    """Raise WrongUse for a table of more than 10,000 columns; ``place`` names it."""
    if count > MAX_COLUMNS:
        raise WrongUse(f"{place}: has {count:,} columns; {MAX_COLUMNS:,} at most")


def format_names(names: Sequence[str]) -> str:
    """Return the first names, and how many there are."""
    shown = ", ".join(shorten(name, SHOWN_LETTERS) for name in names[:MAX_SHOWN])
    return f"{shown}, … ({len(names)})" if len(names) > MAX_SHOWN else shown or "none"


class _Columns:
    """The columns of one table by name; of columns with one name it is the first."""

    def __init__(self, place: object, names: Sequence[str]) -> None:
        self._place, self._names = place, names
        self._places = {name: column for column, name in reversed([*enumerate(names)])}

    def find_range(self, item: str) -> range:
        """Return the columns of a name, a number or a range."""
        first, last = range_ends(item)
        if item in self._places or RANGE not in item:
            column = self._find(item)
            return range(column, column + 1)
        start, stop = self._find(first), self._find(last)
        if stop < start:
            raise WrongUse(
                f"{self._place}: column range {shorten(item)} runs backwards: swap its ends"
            )
        return range(start, stop + 1)

    def _find(self, name: str) -> int:
        if name in self._places:
            return self._places[name]
        if name.isdecimal() and 1 <= int(name) <= len(self._names):
            return int(name) - 1
        raise WrongUse(f"{self._place} has no column {shorten(repr(name))}: {self._hint(name)}")

    def _hint(self, name: str) -> str:
        """Return the most similar of the first names, or all of them."""
        near = [other for other in self._names[:MOST_COMPARED] if len(other) <= COMPARED_LETTERS]
        close = difflib.get_close_matches(name[:COMPARED_LETTERS], near, 1)
        return f"did you mean {close[0]!r}?" if close else f"it has {format_names(self._names)}"


Floats = NDArray[np.float64]
MAX_FILE_TRIALS = 100_000
MAX_VALUE = 1e100
NO_TRIAL = -1


@dataclass(frozen=True, slots=True)
class TrialTable:
    """One trial: ``values`` float64 (n, m), NaN for an empty cell, with the names of its columns.

    ``place`` names file and trial in messages. ``row_numbers``: line of each row, from 1.
    ``labels``: text of each label that a column or field gives.
    """

    path: Path
    place: str
    names: tuple[str, ...]
    values: Floats
    row_numbers: NDArray[np.int64]
    labels: Mapping[str, str] = field(default_factory=dict)

    def indices(self, items: Iterable[str]) -> list[int]:
        """Return the indices of names, numbers or ranges. Raises WrongUse for a missing column."""
        return find_columns(self.place, self.names, items)

    def texts_of(
        self, column: str, texts: Mapping[int, tuple[str, ...]]
    ) -> tuple[NDArray[np.int64], tuple[str, ...]]:
        """Return the place of each row's text among the different texts of a column, and these.

        ``texts``: those of columns that hold places already. A row without a value has -1.
        """
        import pandas

        (index,) = self.indices([column])
        values = np.where(np.isfinite(self.values[:, index]), self.values[:, index], np.nan)
        if index in texts:
            return np.nan_to_num(values, nan=NO_TRIAL).astype(np.int64), texts[index]
        codes, different = pandas.factorize(values, sort=True)
        return codes.astype(np.int64), tuple(f"{value:.12g}" for value in different)


def bounded(values: Floats) -> Floats:
    """Return values with NaN for those beyond 10¹⁰⁰: sums and differences stay numbers."""
    return np.where(np.abs(values) < MAX_VALUE, values, np.nan)


class LabelColumn(NamedTuple):
    """A column that tells trials apart: each row's place among the different ``texts``."""

    name: str
    codes: NDArray[np.int64]
    texts: tuple[str, ...]


class FileTrials(NamedTuple):
    """All trials of one file, and remarks on what was left out of it."""

    trials: tuple[TrialTable, ...]
    remarks: tuple[str, ...]

    @property
    def n_bytes(self) -> int:
        """Memory of all rows."""
        return sum(trial.values.nbytes + trial.row_numbers.nbytes for trial in self.trials)


def split_trials(
    whole: TrialTable, keys: Sequence[LabelColumn], mapping: ImportMap, remarks: Sequence[str]
) -> FileTrials:
    """Return the trials of a table: rows with the same values in all label columns are one.

    Trials are in the order of their first rows. Rows without a value there belong to none.
    Raises WrongUse for a table without trials, or with more than 100,000.
    """
    if not keys:
        return FileTrials((whole,), tuple(remarks))
    import pandas

    codes = pandas.DataFrame({number: key.codes for number, key in enumerate(keys)})
    inside = codes[(codes != NO_TRIAL).all(axis=1)]
    if inside.empty:
        raise WrongUse(f"{whole.place}: no row has a value in {', '.join(k.name for k in keys)}")
    found = inside.groupby(list(inside), sort=False)
    if found.ngroups > MAX_FILE_TRIALS:
        columns = shorten(", ".join(key.name for key in keys))
        raise WrongUse(
            f"{whole.place}: {columns} tell {found.ngroups:,} trials apart, more than "
            f"{MAX_FILE_TRIALS:,}: these columns are no labels"
        )
    trials = tuple(
        _cut(whole, rows.index.to_numpy(), keys, places, mapping) for places, rows in found
    )
    if len(trials) == 1:
        trials = (replace(trials[0], place=whole.place),)
    lost = len(codes) - len(inside)
    left_out = [f"{lost} rows without a label belong to no trial: left out"] if lost else []
    return FileTrials(trials, (*remarks, *left_out))


def _cut(
    whole: TrialTable,
    rows: NDArray[np.int64],
    keys: Sequence[LabelColumn],
    codes: tuple[int, ...],
    mapping: ImportMap,
) -> TrialTable:
    """Return the rows of one trial with its labels."""
    texts = {key.name: key.texts[code] for key, code in zip(keys, codes, strict=True)}
    labels = {
        label: texts[column] for label, column in mapping.labels.columns.items() if column in texts
    }
    trial = f" {texts[mapping.trial_column]}" if mapping.trial_column in texts else ""
    number = f"{whole.place}, trial{trial} from row {whole.row_numbers[rows[0]]}"
    return replace(
        whole,
        place=number,
        values=whole.values[rows],
        row_numbers=whole.row_numbers[rows],
        labels={**whole.labels, **labels},
    )
