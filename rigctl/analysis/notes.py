"""Notes of one kind as one line: a hundred sentences of one form hide the one that matters."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

MOST_OF_A_KIND = 2
"""Notes of one kind that are shown one by one."""
_NUMBER = r"[−-]?\d+(?:[.,]\d+)*+"
_NUMBERS = re.compile(rf"{_NUMBER}(?:, {_NUMBER})*+(?: …)?")
_QUOTED = re.compile(r"'[^']*'")
_PLURALS = re.compile(r"\b(trial|file|scan|taxel|sample)s\b")


def summarise_notes(notes: Iterable[str], *, rest_in: str = "results.json") -> list[str]:
    """Return the notes in their order, several of one kind as the first one with a count.

    Notes are of one kind if they differ in numbers, in texts in quotes, or in what they are about:
    the words before the first colon. ``rest_in``: where the reader finds all of them.
    """
    kinds: dict[str, list[str]] = {}
    for note in notes:
        kinds.setdefault(_kind(note), []).append(note)
    return [line for same in kinds.values() for line in _lines(same, rest_in)]


def _kind(note: str) -> str:
    subject, colon, rest = note.partition(": ")
    text = _NUMBERS.sub("#", _QUOTED.sub("''", rest if colon else subject))
    return _PLURALS.sub(r"\1", text)


def _lines(same: Sequence[str], rest_in: str) -> list[str]:
    if len(same) <= MOST_OF_A_KIND:
        return list(same)
    return [f"{same[0]} (and {len(same) - 1:,} more notes of this kind: {rest_in} has them all)"]
