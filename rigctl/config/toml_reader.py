"""Typed reading of a TOML text, where every mistake is named by file, line and key.

A :class:`TomlTable` hands out values by key, checked for type and range, and
:meth:`TomlTable.finish` refuses what nobody asked for, with the nearest known key as a suggestion.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

from rigctl.errors import WrongUse

_HEADER = re.compile(r"^\s*\[\[?\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")


class TomlText:
    """One TOML text: its name for messages, its source, its error type and its root table.

    Raises ``error`` with the line for text that is not TOML.
    """

    def __init__(self, name: str, text: str, error: type[WrongUse]) -> None:
        self.name = name
        self.source = text
        self.error = error
        self._lines = text.splitlines()
        try:
            data = tomllib.loads(text)
        except (ValueError, RecursionError) as problem:  # TOMLDecodeError is a ValueError
            raise error(f"{name}: this is not TOML: {problem}") from problem
        self.root = TomlTable(self, (), data)

    @classmethod
    def read(cls, path: Path, error: type[WrongUse]) -> TomlText:
        """The text of a file."""
        try:
            return cls(str(path), path.read_text(encoding="utf-8"), error)
        except OSError as problem:
            raise error(f"cannot read {path}: {problem.strerror}") from problem
        except UnicodeDecodeError as problem:
            raise error(f"{path} is not a UTF-8 text") from problem

    def fail(self, place: tuple[str | int, ...], message: str) -> NoReturn:
        """Raise the text's error for the key at ``place``."""
        line = self._line_of(place)
        where = f"{self.name}, line {line}" if line else self.name
        key = _dotted(place)
        raise self.error(f"{where}: {key}: {message}" if key else f"{where}: {message}")

    def _line_of(self, place: tuple[str | int, ...]) -> int | None:
        """Line of the key, or of the table that holds it; found in the text, so best effort."""
        names = tuple(part for part in place if isinstance(part, str))
        wanted = next((part for part in place if isinstance(part, int)), 0)
        for section, key in ((names[:-1], names[-1:]), (names, ())):
            line = self._search(section, key, wanted)
            if line:
                return line
        line = self._search(names[:-1], (), wanted) if len(names) > 1 else None
        return line or self._begins_with(names)

    def _begins_with(self, names: tuple[str, ...]) -> int | None:
        """First line of the dotted name, as a key or in a header, or of the longest part of it."""
        for length in range(len(names), 0, -1):
            dotted = r"\s*\.\s*".join(map(re.escape, names[:length]))
            pattern = re.compile(rf"^\s*\[*\s*{dotted}\s*[=.\]]")
            for number, line in enumerate(self._lines, start=1):
                if pattern.match(line):
                    return number
        return None

    def _search(self, section: tuple[str, ...], key: tuple[str, ...], wanted: int) -> int | None:
        """First line of ``key`` in the ``wanted``-th table headed ``section``."""
        inside, seen = not section, -1
        pattern = re.compile(rf"^\s*[\"']?{re.escape(key[0])}[\"']?\s*[=.]") if key else None
        for number, line in enumerate(self._lines, start=1):
            header = _HEADER.match(line)
            if header:
                inside = header.group(1) == ".".join(section)
                seen += inside
                if inside and seen == wanted and not key:
                    return number
            elif inside and seen in (-1, wanted) and pattern and pattern.match(line):
                return number
        return None


class TomlTable:
    """One table of a text; remembers which keys were asked for."""

    def __init__(self, text: TomlText, place: tuple[str | int, ...], data: dict[str, Any]) -> None:
        self._text = text
        self._place = place
        self._data = data
        self._asked: set[str] = set()

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def __iter__(self) -> Iterator[str]:
        """Every key of this table, in the order of the text."""
        return iter(self._data)

    def allow(self, *keys: str) -> None:
        """Keys that may be absent and are then not asked for."""
        self._asked.update(keys)

    def fail(self, key: str, message: str) -> NoReturn:
        """Raise the text's error for one of this table's keys; '' is the table itself."""
        self._text.fail((*self._place, key) if key else self._place, message)

    def number(
        self, key: str, default: float | None = None, *, unit: str = "", low: float, high: float
    ) -> float:
        """A number within [low, high]; required where there is no default."""
        value = self._take(key, default)
        return self._number(key, value, unit, low, high)

    def integer(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """A whole number within [low, high]."""
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int):
            self.fail(key, f"must be a whole number, not {_say(value)}")
        return int(self._number(key, value, "", low, high))

    def numbers(self, key: str, *, unit: str = "", low: float, high: float) -> tuple[float, ...]:
        """A list of at least one number within [low, high], none twice; empty if absent."""
        values = self._take(key, [])
        if key not in self:
            return ()
        if not isinstance(values, list) or not values:
            self.fail(key, f"must be a list of numbers, such as [{low:g}], not {_say(values)}")
        checked = tuple(self._number(key, value, unit, low, high) for value in values)
        self._refuse_doubles(key, checked)
        return checked

    def integers(
        self, key: str, default: tuple[int, ...], *, low: int, high: int
    ) -> tuple[int, ...]:
        """A list of whole numbers within [low, high]; may be empty or repeat itself."""
        values = self._take(key, list(default))
        if not isinstance(values, list) or any(
            isinstance(v, bool) or not isinstance(v, int) for v in values
        ):
            self.fail(key, f"must be a list of whole numbers, not {_say(values)}")
        return tuple(int(self._number(key, value, "", low, high)) for value in values)

    def text(self, key: str, default: str | None = None) -> str:
        """A text."""
        value = self._take(key, default)
        if not isinstance(value, str):
            self.fail(key, f"must be a text in quotes, not {_say(value)}")
        return value

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of at least one text, none empty, none twice."""
        values = self._take(key, None)
        if not isinstance(values, list) or not values:
            self.fail(key, f'must be a list of texts, such as ["A", "B"], not {_say(values)}')
        for value in values:
            if not isinstance(value, str) or not value:
                self.fail(key, f"must hold texts in quotes, not {_say(value)}")
        self._refuse_doubles(key, tuple(values))
        return tuple(values)

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {_say(value)}")
        return value

    def choice(self, key: str, choices: Iterable[str], default: str | None = None) -> str:
        """One of some words."""
        value = self.text(key, default)
        words = tuple(choices)
        if value not in words:
            self.fail(
                key, f"must be one of {_listed(words)}, not {_say(value)}{_near(value, words)}"
            )
        return value

    def table(self, key: str) -> TomlTable:
        """A table; an absent one is empty, so that its defaults hold."""
        value = self._take(key, {})
        if not isinstance(value, dict):
            self.fail(key, f"must be a table, written [{_dotted((*self._place, key))}]")
        return TomlTable(self._text, (*self._place, key), value)

    def tables(self, key: str) -> list[TomlTable]:
        """A list of tables; an absent one is empty."""
        values = self._take(key, [])
        if not isinstance(values, list) or not all(isinstance(v, dict) for v in values):
            self.fail(key, f"must be tables, each written [[{_dotted((*self._place, key))}]]")
        return [
            TomlTable(self._text, (*self._place, key, place), value)
            for place, value in enumerate(values)
        ]

    def finish(self) -> None:
        """Refuse the first key that nobody asked for."""
        for key in self._data:
            if key not in self._asked:
                hint = _near(key, self._asked) or f"; known here: {_listed(sorted(self._asked))}"
                self.fail(key, f"unknown key{hint}")

    def _take(self, key: str, default: Any) -> Any:
        self._asked.add(key)
        if key not in self._data and default is None:
            close = difflib.get_close_matches(key, set(self._data) - self._asked, 1)
            hint = f"; {close[0]!r} was found, was it meant?" if close else ""
            self.fail(key, f"is missing{hint}")
        return self._data.get(key, default)

    def _number(self, key: str, value: Any, unit: str, low: float, high: float) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(key, f"must be a number, not {_say(value)}")
        if not low <= value <= high:
            in_unit = f" {unit}" if unit else ""
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            self.fail(key, f"{shown} is outside {low:g} to {high:g}{in_unit}")
        return float(value)

    def _refuse_doubles(self, key: str, values: tuple[Any, ...]) -> None:
        for place, value in enumerate(values):
            if value in values[:place]:
                self.fail(key, f"holds {_say(value)} twice")


def _dotted(place: tuple[str | int, ...]) -> str:
    """``steps[2].kind`` for ("steps", 1, "kind"): people count from 1."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += f".{part}" if text else part
    return text


def _say(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value)


def _listed(words: Iterable[str]) -> str:
    return ", ".join(words)


def _near(word: str, words: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, tuple(words), 1)
    return f"; did you mean {close[0]!r}?" if close else ""
