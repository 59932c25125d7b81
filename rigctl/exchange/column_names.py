"""Names of columns, and what a map's names, numbers and ranges of them select."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from rigctl.config.names import shorten
from rigctl.errors import WrongUse

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
