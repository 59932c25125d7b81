"""A key of a TOML table as its reader declares it: type, unit, range, default and meaning.

Loader, form and reference page read the same declarations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any

from rigctl.config.toml_reader import MAX_LETTERS, TomlTable


class FieldType(Enum):
    """What a key holds. Names may become part of a path; the numbers of a list are different."""

    TEXT = auto()
    NAME = auto()
    CHOICE = auto()
    FLAG = auto()
    INTEGER = auto()
    NUMBER = auto()
    NAMES = auto()
    CHOICES = auto()
    NUMBERS = auto()
    INTEGERS = auto()

    @property
    def is_list(self) -> bool:
        """Whether the key holds a list."""
        return self in _LISTS


_LISTS = (FieldType.NAMES, FieldType.CHOICES, FieldType.NUMBERS, FieldType.INTEGERS)


@dataclass(frozen=True, slots=True)
class TomlField:
    """One key. Without a default (None) it is required.

    ``most`` counts the letters of a text or the names of a list, ``longest_bytes`` the bytes of a
    name. ``has_lines``: people write several lines. ``title``: its name for people,
    where that is not the key.
    """

    key: str
    type: FieldType
    doc: str = ""
    default: Any = None
    unit: str = ""
    low: float = 0
    high: float = 0
    choices: tuple[str, ...] = ()
    most: int = MAX_LETTERS
    longest_bytes: int = 0
    may_be_empty: bool = False
    has_lines: bool = False
    title: str = ""

    def read(self, table: TomlTable) -> Any:
        """Return the checked value of the key. Raises the error of the table's text."""
        return _READERS[self.type](table, self)


def _read_choices(table: TomlTable, item: TomlField) -> Any:
    if item.key not in table and item.default is not None:
        table.allow(item.key)
        return item.default
    given = table.texts(item.key)
    for value in given:
        if value not in item.choices:
            table.fail(item.key, f"{value!r} is none of {', '.join(item.choices)}")
    return given


def _read_names(table: TomlTable, item: TomlField) -> Any:
    if item.key not in table and item.default is not None:
        table.allow(item.key)
        return item.default
    return table.names(
        item.key,
        most=item.most,
        longest_bytes=item.longest_bytes,
        may_be_empty=item.may_be_empty,
    )


def _read_numbers(table: TomlTable, item: TomlField) -> Any:
    given = table.numbers(item.key, unit=item.unit, low=item.low, high=item.high)
    return given or item.default


_READERS: dict[FieldType, Callable[[TomlTable, TomlField], Any]] = {
    FieldType.TEXT: lambda table, item: table.text(item.key, item.default, most=item.most),
    FieldType.NAME: lambda table, item: table.name(item.key, item.default),
    FieldType.CHOICE: lambda table, item: table.choice(item.key, item.choices, item.default),
    FieldType.FLAG: lambda table, item: table.flag(item.key, item.default),
    FieldType.INTEGER: lambda table, item: table.integer(
        item.key, item.default, low=int(item.low), high=int(item.high)
    ),
    FieldType.NUMBER: lambda table, item: table.number(
        item.key, item.default, unit=item.unit, low=item.low, high=item.high
    ),
    FieldType.NAMES: _read_names,
    FieldType.CHOICES: _read_choices,
    FieldType.NUMBERS: _read_numbers,
    FieldType.INTEGERS: lambda table, item: table.integers(
        item.key, item.default, low=int(item.low), high=int(item.high)
    ),
}
