"""Rules for the values of a table's column, and the sentence on rows that break one."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.session.read.part import StructuredArray

Column = NDArray[Any]
Mask = NDArray[np.bool_]

MAX_S = 1e9
"""Of any time in a session, thirty years."""


class Rule(NamedTuple):
    """A rule for a column: ``is_right`` returns bool (n,) for its values; ``words``: what fits."""

    column: str
    is_right: Callable[[Column], Mask]
    words: str


def within(column: str, low: float, high: float, unknown: bool = False) -> Rule:
    """Return the rule that values lie from ``low`` to ``high``; ``unknown`` allows NaN."""

    def is_right(values: Column) -> Mask:
        inside: Mask = (values >= low) & (values <= high)
        return inside | np.isnan(values) if unknown else inside

    return Rule(column, is_right, f"not from {low:g} to {high:g}")


def at_least(column: str, low: int) -> Rule:
    """Return the rule that whole numbers are not below ``low``."""
    return Rule(column, lambda values: values >= low, f"below {low}")


def a_time(column: str, unknown: bool = False) -> Rule:
    """Return the rule for a loop time in seconds."""
    return within(column, -MAX_S, MAX_S, unknown)


def one_of(column: str, known: Iterable[Any]) -> Rule:
    """Return the rule that values are among the ``known`` ones."""
    listed = [each.value if isinstance(each, Enum) else each for each in known]
    return Rule(column, lambda values: np.isin(values, listed), "no known value")


def bits(column: str, mask: int) -> Rule:
    """Return the rule that no bit outside ``mask`` is set."""
    return Rule(column, lambda values: (values & ~np.array(mask, values.dtype)) == 0, "has bits "
                "without a meaning")  # fmt: skip


def json_objects(column: str) -> Rule:
    """Return the rule that texts are JSON objects."""
    return Rule(column, _are_objects, "not a JSON object")


def check_rules(path: str, rows: StructuredArray, rules: Iterable[Rule]) -> Iterator[str]:
    """Yield a sentence for each rule that rows of a table break."""
    for rule in rules:
        values = rows[rule.column]
        wrong = np.flatnonzero(~rule.is_right(values))
        if len(wrong):
            yield describe_wrong(f"{rule.column} of {path}", wrong, values, rule.words)


def describe_wrong(what: str, wrong: NDArray[np.int64], values: Column, words: str) -> str:
    """Return a sentence on wrong rows: the first one with its value, and the number of others."""
    shown = str(values[wrong[0]])[:60]
    others = f", and in {len(wrong) - 1} more rows" if len(wrong) > 1 else ""
    return f"{what} is {shown} in row {wrong[0]}, {words}{others}"


def check_ascent(what: str, values: Column) -> Iterator[str]:
    """Yield a sentence where a column runs back."""
    back = np.flatnonzero(values[1:] < values[:-1]) + 1
    if len(back):
        others = f" and {len(back) - 1} more" if len(back) > 1 else ""
        yield f"{what} runs back at row {back[0]}{others}"


def _are_objects(texts: Column) -> Mask:
    return np.fromiter(map(_is_object, texts.tolist()), np.bool_, len(texts))


def _is_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return False
