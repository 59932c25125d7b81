"""What a person types for a key, and the value in the protocol's text.

Whatever is typed becomes a value: what is no number becomes a text, which the loader refuses by
its own words. So the text always holds what the form shows.
"""

from __future__ import annotations

import re
from math import isfinite
from typing import Any

from rigctl.config.toml_bounds import INTEGER_BITS
from rigctl.config.toml_edit import Item, Value
from rigctl.config.toml_field import FieldType, TomlField
from rigctl.config.typed_number import typed_number
from rigctl.errors import WrongUse

_NUMBERS = (FieldType.INTEGER, FieldType.NUMBER, FieldType.INTEGERS, FieldType.NUMBERS)


def value_of(item: TomlField, typed: str) -> Value:
    """Return the value for what is typed; a list is typed as ``40, 60, 80`` or ``40; 60; 80``.

    A comma between two digits of a list of numbers may be its decimal mark or not: ``40,60`` stays
    a text unless semicolons separate the numbers.
    """
    if not item.type.is_list:
        return _item(item, typed)
    parts = [part.strip() for part in _separated(item, typed)]
    while parts and not parts[-1]:
        parts.pop()
    is_clear = ";" in typed
    return [part if "," in part and not is_clear else _item(item, part) for part in parts]


def typed_of(value: Any) -> str:
    """Return what a person would type for a value; empty for None."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return ", ".join(map(typed_of, value))
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def help_of(item: TomlField) -> str:
    """Return a sentence of help for a key: its meaning, its range and its default."""
    meaning = item.doc.replace("`", "")
    reach = f"{_short(item.low)} to {_short(item.high)}" if item.high else ""
    unit = f" {item.unit}" if item.unit and reach else ""
    has_default = item.default not in (None, (), "") and item.type is not FieldType.CHOICES
    default = f"default {typed_of(item.default)}" if has_default else ""
    return "; ".join(part for part in (meaning, f"{reach}{unit}", default) if part)


def default_of(item: TomlField) -> str:
    """Return the default of a key in a word or two; a long one stands in the help."""
    if item.default is None:
        return "needed"
    if item.default in ((), ""):
        return "none"
    if item.type is FieldType.CHOICES:
        return "all"
    return "the default" if item.type is FieldType.TEXT else typed_of(item.default)


def _short(number: float) -> str:
    whole = f"{int(number):,}".replace(",", "\u202f")  # a comma would be a decimal mark
    return whole if number == int(number) else f"{number:g}"


def _separated(item: TomlField, typed: str) -> list[str]:
    if item.type not in _NUMBERS:
        return typed.split(",")
    return typed.split(";") if ";" in typed else re.split(r",(?![0-9])", typed)


def _item(item: TomlField, typed: str) -> Item:
    return _number(typed) if item.type in _NUMBERS else typed


def _number(typed: str) -> Item:
    try:
        number = typed_number(typed)
    except WrongUse:
        return typed.strip()
    is_whole = number.as_tuple().exponent == 0 and int(number).bit_length() <= INTEGER_BITS
    value = int(number) if is_whole else float(number)
    return value if isfinite(value) else typed.strip()
