"""Read and check the values of a TOML text; every error names file, line and key.

A :class:`TomlTable` returns values by key after a check of type and range, and
:meth:`TomlTable.finish` refuses unknown keys and suggests the most similar known one.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields
from enum import Enum, auto
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

from rigctl.config.text_file import MAX_NAME_BYTES, name_problem, read_text, shorten, visible_line
from rigctl.config.typed_number import has_group_marks
from rigctl.errors import WrongUse

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

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


_TABLE_HEADER = re.compile(r"\s*+\[\[?(?P<name>[^\[\]]++)\]\]?\s*+(#.*)?")
_KEY = re.compile(r"\s*+(?P<name>[^#=\[\]]++)=")


def lines_of_paths(source: str) -> dict[KeyPath, int]:
    """Return the first line of each key and table; it may miss unusually formatted ones."""
    found: dict[KeyPath, int] = {}
    for number, path in _numbered_paths(source):
        for length in range(1, len(path) + 1):
            found.setdefault(path[:length], number)
    return found


def _numbered_paths(source: str) -> Iterator[tuple[int, KeyPath]]:
    table: KeyPath = ()
    n_tables: Counter[KeyPath] = Counter()
    for number, line in enumerate(source.splitlines(), start=1):
        if header := _TABLE_HEADER.fullmatch(line):
            table = _split(header["name"])
            if line.lstrip().startswith("[["):
                n_tables[table] += 1
                table = (*table, n_tables[table] - 1)
            yield number, table
        elif key := _KEY.match(line):
            yield number, table + _split(key["name"])


def _split(name: str) -> KeyPath:
    parts = name.split(".", MAX_DEPTH)
    return tuple(part.strip().strip("\"'") for part in parts)


MAX_LETTERS = 1000
"""Letters of a text, unless its reader allows more."""


class TomlText:
    """One TOML text: its name for messages, its source, its error type and its root table.

    Raises ``error`` with the line for text that is not valid TOML, or beyond the limits of
    :mod:`rigctl.config.toml_reader`.
    """

    def __init__(self, name: str, text: str, error: type[WrongUse]) -> None:
        self.name = name
        self.source = text
        self.error = error
        try:
            data = parse_bounded(text)
        except OutOfBounds as problem:
            raise error(f"{name} {problem}") from problem
        except ValueError as problem:
            raise error(f"{name}: this is not TOML: {shorten(str(problem), 200)}") from problem
        if excess := find_excess(data):
            self.fail(*excess)
        self.root = TomlTable(self, (), data)

    @classmethod
    def read(cls, path: Path, error: type[WrongUse]) -> TomlText:
        """Read a file."""
        return cls(str(path), read_text(path, MAX_BYTES, error), error)

    def fail(self, path: KeyPath, message: str) -> NoReturn:
        """Raise the text's error for the key at ``path``."""
        line = self._line_of(path)
        where = f"{self.name}, line {line}" if line else self.name
        key = _dotted(path)
        sentence = f"{where}: {key}: {message}" if key else f"{where}: {message}"
        error = self.error(visible_line(sentence))
        error.key_path, error.line, error.reason = path, line or 0, visible_line(message)
        raise error

    def _line_of(self, path: KeyPath) -> int | None:
        """Return the line of the key, or of the longest part of its path that has one."""
        lines = lines_of_paths(self.source)
        parts = (path[:length] for length in range(len(path), 0, -1))
        return next((lines[part] for part in parts if part in lines), None)


class TomlTable:
    """One table of a text; it remembers which keys its reader has asked for."""

    def __init__(self, text: TomlText, path: KeyPath, data: dict[str, Any]) -> None:
        self._text = text
        self._path = path
        self._data = data
        self._known: set[str] = set()

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def __iter__(self) -> Iterator[str]:
        """Yield the keys of this table in the order of the text."""
        return iter(self._data)

    def as_written(self, key: str) -> Any:
        """Return the value of a key without a check; None where it is missing."""
        return self._data.get(key)

    def is_text(self, key: str) -> bool:
        """Return whether the key has a text: of one that may be a text or a table."""
        return isinstance(self._data.get(key), str)

    def allow(self, *keys: str) -> None:
        """Declare keys that are read only if they are present."""
        self._known.update(keys)

    def fail(self, key: str, message: str) -> NoReturn:
        """Raise the text's error for one of this table's keys; '' is the table itself."""
        self._text.fail((*self._path, key) if key else self._path, message)

    def number(
        self, key: str, default: float | None = None, *, unit: str = "", low: float, high: float
    ) -> float:
        """Return a number within [low, high]; without a default the key is required."""
        value = self._take(key, default)
        return self._number(key, value, unit, low, high)

    def integer(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """Return a whole number within [low, high]."""
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(key, f"must be a whole number, not {_format(value)}")
        return int(self._number(key, value, "", low, high))

    def numbers(self, key: str, *, unit: str = "", low: float, high: float) -> tuple[float, ...]:
        """Return a list of different numbers within [low, high]; empty if missing."""
        values = self._take(key, [])
        if key not in self:
            return ()
        if not isinstance(values, list) or not values:
            self.fail(key, f"must be a list of numbers, such as [{low:g}], not {_format(values)}")
        for value in values:
            self._refuse_run_together(key, value)
        checked = tuple(self._number(key, value, unit, low, high) for value in values)
        self._refuse_duplicates(key, checked)
        return checked

    def vector(
        self, key: str, size: int, *, unit: str = "", low: float, high: float
    ) -> tuple[float, ...]:
        """Return a list of ``size`` numbers within [low, high], possibly with duplicates."""
        values = self._take(key, None)
        if not isinstance(values, list) or len(values) != size:
            self.fail(key, f"must be a list of {size} numbers, not {_format(values)}")
        return tuple(self._number(key, value, unit, low, high) for value in values)

    def integers(
        self, key: str, default: tuple[int, ...], *, low: int, high: int
    ) -> tuple[int, ...]:
        """Return a list of whole numbers within [low, high], possibly empty or with duplicates."""
        values = self._take(key, list(default))
        if not isinstance(values, list) or any(
            isinstance(v, bool) or not isinstance(v, int) for v in values
        ):
            self.fail(key, f"must be a list of whole numbers, not {_format(values)}")
        return tuple(int(self._number(key, value, "", low, high)) for value in values)

    def text(self, key: str, default: str | None = None, *, most: int = MAX_LETTERS) -> str:
        """Return a text of at most ``most`` letters."""
        value = self._take(key, default)
        if not isinstance(value, str):
            self.fail(key, f"must be a text in quotes, not {_format(value)}")
        if len(value) > most:
            self.fail(key, f"has {len(value):,} letters; {most:,} are the most")
        return value

    def name(self, key: str, default: str) -> str:
        """Return a name that may become part of a path; see :mod:`rigctl.config.text_file`."""
        value = self.text(key, default)
        self._refuse_unsafe(key, value, MAX_NAME_BYTES)
        return value

    def names(
        self, key: str, *, most: int, longest_bytes: int, may_be_empty: bool = False
    ) -> tuple[str, ...]:
        """Return a list of 1 to ``most`` different names of at most ``longest_bytes`` bytes.

        With ``may_be_empty``, the list may be missing or empty.
        """
        if may_be_empty and self._take(key, []) == []:
            return ()
        values = self.texts(key)
        if len(values) > most:
            self.fail(key, f"has {len(values):,} names; {most:,} are the most")
        for value in values:
            self._refuse_unsafe(key, value, longest_bytes)
        return values

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of at least one text; all are different and none is empty."""
        values = self._take(key, None)
        if not isinstance(values, list) or not values:
            self.fail(key, f'must be a list of texts, such as ["A", "B"], not {_format(values)}')
        for value in values:
            if not isinstance(value, str) or not value:
                self.fail(key, f"must contain texts in quotes, not {_format(value)}")
            if len(value) > MAX_LETTERS:
                self.fail(key, f"contains a text of more than {MAX_LETTERS:,} letters")
        self._refuse_duplicates(key, tuple(values))
        return tuple(values)

    def arguments(self, key: str) -> tuple[str, ...]:
        """Return the arguments of a command, possibly none or with duplicates."""
        values = self._take(key, [])
        if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
            self.fail(key, f'must be a list of texts, such as ["A", "B"], not {_format(values)}')
        if any("\0" in value or len(value) > MAX_LETTERS for value in values):
            self.fail(key, f"contains a text with U+0000 or of more than {MAX_LETTERS:,} letters")
        return tuple(values)

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {_format(value)}")
        return value

    def choice(self, key: str, choices: Iterable[str], default: str | None = None) -> str:
        """Return a text that is one of ``choices``."""
        value = self.text(key, default)
        words = tuple(choices)
        if value not in words:
            hint = _suggestion(value, words)
            self.fail(key, f"must be one of {', '.join(words)}, not {_format(value)}{hint}")
        return value

    def table(self, key: str) -> TomlTable:
        """Return a table; a missing one is empty, so that its defaults apply."""
        value = self._take(key, {})
        if not isinstance(value, dict):
            self.fail(key, f"must be a table, written [{_dotted((*self._path, key))}]")
        return TomlTable(self._text, (*self._path, key), value)

    def tables(self, key: str) -> list[TomlTable]:
        """Return a list of tables; a missing one is empty."""
        values = self._take(key, [])
        if not isinstance(values, list) or not all(isinstance(v, dict) for v in values):
            self.fail(key, f"must be tables, each written [[{_dotted((*self._path, key))}]]")
        return [
            TomlTable(self._text, (*self._path, key, index), value)
            for index, value in enumerate(values)
        ]

    def finish(self) -> None:
        """Raise the text's error for the first unknown key."""
        for key in self._data:
            if key not in self._known:
                known = ", ".join(sorted(self._known))
                hint = _suggestion(key, self._known) or f"; known keys: {known}"
                self.fail(key, f"unknown key{hint}")

    def _take(self, key: str, default: Any) -> Any:
        self._known.add(key)
        if key not in self._data and default is None:
            close = difflib.get_close_matches(key, set(self._data) - self._known, 1)
            hint = f"; is {close[0]!r} a misspelling of it?" if close else ""
            self.fail(key, f"is missing{hint}")
        return self._data.get(key, default)

    def _number(self, key: str, value: Any, unit: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            cure = "leave out the marks between groups of digits"
            ending = f": {cure}" if has_group_marks(value) else ""
            self.fail(key, f"must be a number, not {_format(value)}{ending}")
        if not low <= value <= high:
            in_unit = f" {unit}" if unit else ""
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            self.fail(key, f"{shown} is outside {low:g} to {high:g}{in_unit}")
        return float(value)

    def _refuse_run_together(self, key: str, value: Any) -> None:
        """Raise for a text of several numbers, such as a person types without commas."""
        parts = value.replace(";", " ").split() if isinstance(value, str) else ()
        if len(parts) == 1 and "," in value and all(map(_is_number, value.split(","))):
            both = value.replace(",", ", ")
            self.fail(key, f"{value} may be one number or more: type {both} or use a decimal point")
        if len(parts) > 1 and all(map(_is_number, parts)):
            self.fail(key, f"{_format(value)} is not one number: separate numbers by commas")

    def _refuse_unsafe(self, key: str, name: str, longest_bytes: int) -> None:
        if problem := name_problem(name, longest_bytes):
            self.fail(key, problem)

    def _refuse_duplicates(self, key: str, values: tuple[Any, ...]) -> None:
        seen: set[Any] = set()
        for value in values:
            if value in seen:
                self.fail(key, f"contains {_format(value)} twice")
            seen.add(value)


def _dotted(path: KeyPath) -> str:
    """Return ``steps[2].kind`` for ("steps", 1, "kind"), because users count from 1."""
    parts = (f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _format(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    return shorten(repr(value))


def _suggestion(word: str, words: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, tuple(words), 1)
    return f"; did you mean {close[0]!r}?" if close else ""


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
    ARGUMENTS = auto()

    @property
    def is_list(self) -> bool:
        """Whether the key holds a list."""
        return self in _LISTS


_LISTS = (
    FieldType.NAMES,
    FieldType.CHOICES,
    FieldType.NUMBERS,
    FieldType.INTEGERS,
    FieldType.ARGUMENTS,
)


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
    FieldType.ARGUMENTS: lambda table, item: table.arguments(item.key),
}


_Section = TypeVar("_Section", bound="DataclassInstance")


def number(
    default: float | tuple[float, ...],
    unit: str,
    low: float,
    high: float,
    doc: str = "",
    *,
    repr: bool = True,
) -> Any:
    """Declare a number, a whole number or a tuple of either; the annotation says which.

    Numbers in a tuple of floats are different. ``repr``: whether the section's repr has it.
    """
    metadata = {"unit": unit, "low": low, "high": high, "doc": doc}
    return field(default=default, repr=repr, metadata=metadata)


def text(default: str, doc: str, choices: tuple[str, ...] = ()) -> Any:
    """Declare a text, one of ``choices`` if there are any."""
    return field(default=default, metadata={"unit": "", "doc": doc, "choices": choices})


def texts(default: tuple[str, ...], doc: str, choices: tuple[str, ...]) -> Any:
    """Declare a tuple of different texts, each one of ``choices``."""
    return field(default=default, metadata={"unit": "", "doc": doc, "choices": choices})


def names(doc: str, most: int, longest_bytes: int) -> Any:
    """Declare a list of different names, empty by default."""
    limits = {"most": most, "longest_bytes": longest_bytes}
    return field(default=(), metadata={"unit": "", "doc": doc, **limits})


def arguments(doc: str) -> Any:
    """Declare the arguments of a command, none by default."""
    return field(default=(), metadata={"unit": "", "doc": doc})


def flag(default: bool, doc: str) -> Any:
    """Declare true or false."""
    return field(default=default, metadata={"unit": "", "doc": doc})


def section_fields(kind: type[Any]) -> tuple[TomlField, ...]:
    """Return the keys of a section as its dataclass declares them."""
    return tuple(_toml_field(item) for item in fields(kind))


def read_section(table: TomlTable, kind: type[_Section]) -> _Section:
    """Return the dataclass ``kind`` with the table's values; a missing key has its default.

    Raises the error of the table's text for an unknown key or an invalid value.
    """
    values = {item.key: item.read(table) for item in section_fields(kind)}
    table.finish()
    return kind(**values)


def _toml_field(item: Any) -> TomlField:
    is_name_list = "longest_bytes" in item.metadata
    return TomlField(
        item.name, _field_type(item), default=item.default, may_be_empty=is_name_list,
        **item.metadata,
    )  # fmt: skip


def _field_type(item: Any) -> FieldType:
    if isinstance(item.default, bool):
        return FieldType.FLAG
    if isinstance(item.default, str):
        return FieldType.CHOICE if item.metadata["choices"] else FieldType.TEXT
    if "longest_bytes" in item.metadata:
        return FieldType.NAMES
    if item.type == "tuple[str, ...]" and "choices" not in item.metadata:
        return FieldType.ARGUMENTS
    return _TYPES[item.type]


_TYPES = {
    "int": FieldType.INTEGER,
    "float": FieldType.NUMBER,
    "tuple[str, ...]": FieldType.CHOICES,
    "tuple[int, ...]": FieldType.INTEGERS,
    "tuple[float, ...]": FieldType.NUMBERS,
}
