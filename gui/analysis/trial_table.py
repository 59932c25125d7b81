"""The attempts of sessions as columns. This module does not import Qt."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

MANY = 20
Rows = NDArray[np.int64]
NUMBER = re.compile(r"(#?)([0-9.]+)([^0-9.].*)?")


class AttemptColumn(NamedTuple):
    """A column of a table.

    ``values``: float64 or int64 (n,), or with ``texts`` the index of each row's text, int64 (n,).
    ``name``: with the unit where there is one; ``meaning``: in a sentence for a tooltip.
    """

    name: str
    values: NDArray[Any]
    texts: tuple[str, ...] = ()
    meaning: str = ""

    @classmethod
    def of_texts(cls, name: str, cells: ArrayLike, meaning: str = "") -> AttemptColumn:
        """Return a column of texts; they are sorted by their alphabet."""
        texts, indices = np.unique(np.asarray(cells, np.str_), return_inverse=True)
        return cls(name, indices.astype(np.int64), tuple(map(str, texts)), meaning)

    def text(self, row: int) -> str:
        """Return the text of a cell; a number that is not known is a dash."""
        value = self.values[row]
        if self.texts:
            return self.texts[int(value)]
        if isinstance(value, np.integer):
            return str(value)
        return f"{value:.4g}" if np.isfinite(value) else "–"

    def widest_texts(self) -> tuple[str, ...]:
        """Return texts of which one is the widest cell."""
        if self.texts:
            return tuple(sorted(self.texts, key=len)[-MANY:])
        if not len(self.values):
            return ("",)
        some = *range(0, len(self.values), -(-len(self.values) // MANY)), len(self.values) - 1
        ends = self.values.argmin(), self.values.argmax()
        return tuple(self.text(int(row)) for row in (*ends, *some))

    def matches(self, word: str) -> NDArray[np.bool_]:
        """Return which cells a word of a filter means, bool (n,)."""
        if self.texts:
            chosen = np.array([_begins(text, word) for text in self.texts])
            found_texts: NDArray[np.bool_] = chosen[self.values]
            return found_texts
        found = NUMBER.fullmatch(word)
        if found is None or not _is_number(found[2]):
            return np.zeros(len(self.values), bool)
        unit = "Trial" if found[1] else found[3] or ""
        if unit.lower() not in self.name.lower():
            return np.zeros(len(self.values), bool)
        close: NDArray[np.bool_] = np.isclose(self.values, float(found[2]), rtol=1e-3)
        return close


class AttemptTable(NamedTuple):
    """Trials of several sessions: ``session`` int64 (n,), ``row`` int64 (n,) in its session."""

    columns: tuple[AttemptColumn, ...] = ()
    session: Rows = np.empty(0, np.int64)
    row: Rows = np.empty(0, np.int64)

    def __len__(self) -> int:
        """Return the number of trials."""
        return len(self.row)

    def sorted_rows(self, column: int, *, descending: bool) -> Rows:
        """Return all rows in the order of a column; equal ones keep theirs."""
        values = self.columns[column].values
        return np.argsort(-values if descending else values, kind="stable").astype(np.int64)

    def matching(self, words: str) -> NDArray[np.bool_]:
        """Return which rows contain each of some words in any column, bool (n,)."""
        kept = np.ones(len(self), bool)
        for word in words.split():
            exact = self._exact(word)
            columns = [column for column in self.columns if word in column.texts and exact]
            found = [column.matches(word) for column in columns or self.columns]
            kept &= np.any(found, axis=0)
        return kept

    def _exact(self, word: str) -> bool:
        return any(word in column.texts for column in self.columns)


def join_tables(names: Sequence[str], tables: Sequence[Sequence[AttemptColumn]]) -> AttemptTable:
    """Return the trials of several sessions in one table; several begin with their names.

    All tables have the same columns.
    """
    lengths = [len(columns[0].values) for columns in tables]
    columns = [_join([one[i] for one in tables]) for i in range(len(tables[0]))]
    session = np.repeat(np.arange(len(tables)), lengths)
    if len(tables) > 1:
        cells = np.repeat(np.array(names, np.str_), lengths)
        columns.append(AttemptColumn.of_texts("Session", cells.tolist(), "Folder of the session"))
    row = np.concatenate([np.arange(n) for n in lengths])
    return AttemptTable(tuple(columns), session.astype(np.int64), row.astype(np.int64))


def _join(parts: Sequence[AttemptColumn]) -> AttemptColumn:
    first = parts[0]
    if len(parts) == 1:
        return first
    if not any(part.texts for part in parts):
        return first._replace(values=np.concatenate([part.values for part in parts]))
    texts = sorted({text for part in parts for text in part.texts})
    places = {text: i for i, text in enumerate(texts)}
    renumbered = [
        np.array([places[text] for text in part.texts], np.int64)[part.values] for part in parts
    ]
    return first._replace(values=np.concatenate(renumbered), texts=tuple(texts))


def _begins(text: str, word: str) -> bool:
    """Return whether a text, or any word in it, begins with a word of a filter."""
    return any(part.startswith(word.lower()) for part in (text.lower(), *text.lower().split()))


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False
