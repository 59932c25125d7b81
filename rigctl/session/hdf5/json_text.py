"""Parse JSON that a file contains into a declared type."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from rigctl.session.hdf5.errors import damage, describe

T = TypeVar("T")
MOST_DIGITS = 20
"""Longer integers fit no value of a session, and some take minutes to print."""
_NAMES: Mapping[type, str] = {dict: "an object", list: "a list"}


def parse_json(text: str, wanted: type[T], path: Path, place: str) -> T:
    """Return the value of a JSON text, a ``list`` or a ``dict``.

    Raises SessionError for another type, for text that is not JSON, is nested too deep to parse,
    or contains an integer of more than ``MOST_DIGITS`` digits.
    """
    try:
        value = json.loads(text, parse_int=_parse_int)
    except (ValueError, RecursionError) as error:
        raise damage(path, place, f"is not JSON: {describe(error)}") from error
    if not isinstance(value, wanted):
        raise damage(path, place, f"should be {_NAMES.get(wanted, wanted.__name__)} in JSON")
    return value


def parse_objects(text: str, path: Path, place: str) -> tuple[dict[str, Any], ...]:
    """Return the objects of a JSON list. Raises SessionError as :func:`parse_json` does."""
    items = parse_json(text, list, path, place)
    if not all(isinstance(item, dict) for item in items):
        raise damage(path, place, "should be a list of objects in JSON")
    return tuple(items)


def _parse_int(digits: str) -> int:
    if len(digits.lstrip("-")) > MOST_DIGITS:
        raise ValueError(f"an integer has {len(digits)} digits")
    return int(digits)
