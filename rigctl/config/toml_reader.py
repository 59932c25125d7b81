"""Read and check the values of a TOML text; every error names file, line and key.

A :class:`TomlTable` returns values by key after a check of type and range, and
:meth:`TomlTable.finish` refuses unknown keys and suggests the most similar known one.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

from rigctl.config.names import MAX_NAME_BYTES, name_problem, shorten
from rigctl.config.text_file import read_text
from rigctl.config.toml_bounds import MAX_BYTES, KeyPath, OutOfBounds, find_excess, parse_bounded
from rigctl.config.toml_lines import lines_of_paths
from rigctl.config.typed_number import has_group_marks
from rigctl.config.visible_text import visible_line
from rigctl.errors import WrongUse

MAX_LETTERS = 1000
"""Letters of a text, unless its reader allows more."""


class TomlText:
    """One TOML text: its name for messages, its source, its error type and its root table.

    Raises ``error`` with the line for text that is not valid TOML, or beyond the limits of
    :mod:`rigctl.config.toml_bounds`.
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
        """Return a name that may become part of a path; see :mod:`rigctl.config.names`."""
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
