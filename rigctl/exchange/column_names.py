"""Names of columns, and what a map's names, numbers and ranges of them select."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from rigctl.errors import WrongUse

RANGE = ".."
MAX_COLUMNS = 10_000
MAX_SHOWN = 12


def find_columns(place: object, names: Sequence[str], items: Iterable[str]) -> list[int]:
    """Return the indices of names, numbers from 1 or ranges of either.

    ``place`` names the file or trial in messages. Raises WrongUse for a missing column.
    """
    found: list[int] = []
    for item in items:
        found += _find_range(place, names, item)
        if len(found) > MAX_COLUMNS:
            raise WrongUse(f"{place}: more than {MAX_COLUMNS:,} columns are mapped")
    return found


def range_ends(item: str) -> tuple[str, str]:
    """Return the two ends of a range, twice the same for a single column."""
    first, dots, last = item.partition(RANGE)
    return (first.strip(), last.strip()) if dots else (item, item)


def format_names(names: Sequence[str]) -> str:
    """Return the first names, and how many there are."""
    shown = ", ".join(names[:MAX_SHOWN])
    return f"{shown}, … ({len(names)})" if len(names) > MAX_SHOWN else shown or "none"


def _find_range(place: object, names: Sequence[str], item: str) -> range:
    first, last = range_ends(item)
    if item in names or RANGE not in item:
        index = _find(place, names, item)
        return range(index, index + 1)
    start, stop = _find(place, names, first), _find(place, names, last)
    if stop < start:
        raise WrongUse(f"{place}: column range {item} runs backwards: swap its ends")
    return range(start, stop + 1)


def _find(place: object, names: Sequence[str], name: str) -> int:
    if name in names:
        return names.index(name)
    if name.isdecimal() and 1 <= int(name) <= len(names):
        return int(name) - 1
    close = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {close[0]!r}?" if close else f"it has {format_names(names)}"
    raise WrongUse(f"{place} has no column {name!r}: {hint}")
