"""Limits of a TOML text, checked before and after it is parsed, so that no text is slow to refuse.

The parser's time grows with the square of a key's parts, and Python refuses to print a number of
thousands of digits: both come from one line of a hostile file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

MAX_BYTES = 262_144
"""Size of a TOML file: a protocol has a few kB, a rig of 1024 taxels 20 kB."""
MAX_DEPTH = 16
"""Tables in tables, or parts of a dotted key."""
MAX_KEY_LETTERS = 100
INTEGER_BITS = 63
"""TOML's own range of whole numbers."""

KeyPath = tuple[str | int, ...]
"""The path of a key: the names of tables, the indices of repeated tables, the key."""

# What is not closed reaches to the end: a shorter match would make the search quadratic.
TEXTS_AND_COMMENTS = re.compile(
    r'"""(?:\\[\s\S]|[^\\])*?(?:"""|\Z)'
    r"|'''[\s\S]*?(?:'''|\Z)"
    r'|"(?:\\.|[^"\\\n])*+"?'
    r"|'[^'\n]*+'?"
    r"|\#[^\n]*+"
)
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")


class OutOfBounds(ValueError):
    """A TOML text that is larger or deeper than any that rigctl needs."""


def parse_bounded(text: str) -> dict[str, Any]:
    """Parse a TOML text. Raises OutOfBounds, and ValueError where it is no TOML."""
    if len(text) > MAX_BYTES or len(text.encode("utf-8", "surrogatepass")) > MAX_BYTES:
        raise OutOfBounds(f"is larger than {MAX_BYTES:,} bytes: no such file is")
    _refuse_long_keys(text)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise OutOfBounds(f"has more than {MAX_DEPTH} tables or lists in each other") from None


def find_excess(data: dict[str, Any]) -> tuple[KeyPath, str] | None:
    """Return the path of a value beyond the limits and what it exceeds; None if there is none."""
    waiting: list[tuple[KeyPath, Any]] = [((), data)]
    while waiting:
        path, value = waiting.pop()
        if excess := _excess(path, value):
            return path, excess
        waiting += _items(path, value)
    return None


def _excess(path: KeyPath, value: Any) -> str:
    if isinstance(value, int) and value.bit_length() > INTEGER_BITS:
        return "is a whole number of more than 64 bits"
    if len(path) > MAX_DEPTH:
        return f"is deeper than {MAX_DEPTH} tables or lists in each other"
    if isinstance(value, dict) and any(len(key) > MAX_KEY_LETTERS for key in value):
        return f"has a key of more than {MAX_KEY_LETTERS} letters"
    return ""


def _items(path: KeyPath, value: Any) -> Iterator[tuple[KeyPath, Any]]:
    if isinstance(value, dict):
        yield from (((*path, key), item) for key, item in value.items())
    elif isinstance(value, list):
        yield from (((*path, index), item) for index, item in enumerate(value))


def _refuse_long_keys(text: str) -> None:
    """Raise OutOfBounds for a dotted key of too many parts, whose parsing would take minutes."""
    plain = TEXTS_AND_COMMENTS.sub("-", text)
    for number, line in enumerate(plain.split("\n"), start=1):
        if any(part.count(".") >= MAX_DEPTH for part in _BETWEEN_KEYS.split(line)):
            raise OutOfBounds(f"has a key of more than {MAX_DEPTH} parts (about line {number})")
