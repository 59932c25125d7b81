"""A pattern for the labels in the names of files and folders, from what differs among them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.errors import WrongUse
from rigctl.exchange.guess.words import ANY_UNIT, find_unit, first_role
from rigctl.exchange.recording_files import common_folder

SLASH = "/"
_DATE_DIGITS, _WORD_LETTERS, _FIRST_REPEAT = 6, 3, 3
_WITH_UNITS = ("speed", "force")
_SIGNED, _UNSIGNED = "-?", ""
_TOKEN = (
    r"(?P<prefix>[^\W\d_]*)(?P<number>{sign}\d+(?:[.,]\d+)?)"
    rf"(?P<suffix>[ _]?(?i:{ANY_UNIT})(?![^\W\d_])|[^\W\d_]*)"
    r"|(?P<words>[^\W\d_]+(?:[ _-][^\W\d_]+(?![^\W_]))*)|(?P<mark>.)"
)


@dataclass(slots=True)
class NamePart:
    """One part of all names: a number between letters, words, or a mark; a value for each file."""

    kind: str
    values: tuple[str, ...]
    prefix: str = ""
    suffix: str = ""
    role: str = ""

    @property
    def varies(self) -> bool:
        """Whether the files differ in it."""
        return len(set(self.values)) > 1

    def unit(self, role: str) -> str:
        """Return the unit of that role behind the number, empty if there is none."""
        return find_unit(role, f"_{self.suffix}") if self.suffix else ""


@dataclass(frozen=True, slots=True)
class NamePattern:
    """The pattern, the values of each label over all files, units, and what was assumed."""

    pattern: str = ""
    labels: dict[str, tuple[str, ...]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


def guess_pattern(paths: Sequence[Path], wanted: Iterable[str]) -> NamePattern:
    """Return a pattern for the ``wanted`` labels in names and folders; none for equal labels.

    Raises WrongUse for files at different depths of a tree, and for names of two forms.
    """
    names = _relative_names(paths)
    parts = _parts(names, paths)
    assumed = _assign(parts, wanted)
    found = {part.role: part.values for part in parts if part.role}
    if not found:
        return NamePattern()
    units = {
        part.role: unit
        for part in parts
        if part.role in _WITH_UNITS and (unit := part.unit(part.role))
    }
    by_path = any(SLASH in name for name in names)
    return NamePattern(_write(parts, by_path), found, units, tuple(assumed))


def _relative_names(paths: Sequence[Path]) -> list[str]:
    """Return each path below the common folder, without its suffix."""
    folder = common_folder(paths)
    names = [path.absolute().relative_to(folder).with_suffix("").as_posix() for path in paths]
    depths = {name.count(SLASH): path for name, path in zip(names, paths, strict=True)}
    if len(depths) > 1:
        first, second, *_ = depths.values()
        raise WrongUse(
            f"{first} and {second} are not at the same depth of folders: guess a map for each"
        )
    return names


def _parts(names: Sequence[str], paths: Sequence[Path]) -> list[NamePart]:
    """Return the parts that all names have. Raises WrongUse for names of two forms."""
    for sign in (_UNSIGNED, _SIGNED):
        expression = re.compile(_TOKEN.format(sign=sign))
        split = [list(expression.finditer(name)) for name in names]
        if len({_form(tokens) for tokens in split}) == 1:
            return [part for column in zip(*split, strict=True) for part in _split_token(column)]
    forms = {_form(tokens): path for tokens, path in zip(split, paths, strict=True)}
    first, second, *_ = forms.values()
    raise WrongUse(
        f"{first.name} and {second.name} are names of two forms: guess a map for each, or write "
        "[files] pattern yourself"
    )


def _form(tokens: Sequence[re.Match[str]]) -> tuple[str, ...]:
    """Return what must be equal in the names of one form: kinds of parts, marks and suffixes."""
    return tuple(
        token["mark"] or ("words" if token["words"] else token["suffix"]) for token in tokens
    )


def _split_token(column: Sequence[re.Match[str]]) -> list[NamePart]:
    """Return the parts of one token of all names: letters that differ before a number are words."""
    first = column[0]
    whole = tuple(token[0] for token in column)
    if first["number"] is None:
        return [NamePart("words" if first["words"] else "mark", whole)]
    prefixes = tuple(token["prefix"] for token in column)
    numbers = tuple(token["number"] for token in column)
    if len(set(prefixes)) == 1:
        return [NamePart("number", numbers, prefixes[0], first["suffix"])]
    if min(map(len, prefixes)) < _WORD_LETTERS:
        return [NamePart("words", whole)]
    return [NamePart("words", prefixes), NamePart("number", numbers, "", first["suffix"])]


def _assign(parts: Sequence[NamePart], wanted: Iterable[str]) -> list[str]:
    """Give the wanted roles to parts by units and words, then by order; return the latter."""
    left = list(wanted)
    numbers = [part for part in parts if part.kind == "number"]
    for part in numbers:
        if role := next((r for r in _WITH_UNITS if r in left and part.unit(r)), ""):
            _take(part, role, left)
    for index, part in enumerate(parts):
        if part in numbers and not part.role and (role := _word_role(parts, index, left)):
            _take(part, role, left)
    _assign_texture(parts, left)
    plain = [p for p in numbers if not p.role and not p.prefix and _is_short(p.values)]
    assumed = []
    if "repeat" in left and plain and _counts(plain[-1].values):
        assumed.append(_take(plain.pop(), "repeat", left))
    by_order = [role for role in _WITH_UNITS if role in left]
    return assumed + [_take(p, role, left) for p, role in zip(plain, by_order, strict=False)]


def _assign_texture(parts: Sequence[NamePart], left: list[str]) -> None:
    """Take the first words that differ, else numbers after a letter.

    Words that are the same in all names are a texture only if these also have speed or force.
    """
    if "texture" not in left:
        return
    words = [part for part in parts if part.kind == "words"]
    coded = [p for p in parts if p.kind == "number" and p.prefix and p.varies and not p.role]
    labelled = any(part.role in _WITH_UNITS for part in parts)
    same = [part for part in words if labelled and not _is_label_word(part.values[0])]
    for part in [*(w for w in words if w.varies), *coded, *same][:1]:
        if part.kind == "number":
            part.values = tuple(f"{part.prefix}{value}{part.suffix}" for value in part.values)
            part.kind = "words"
        _take(part, "texture", left)


def _is_label_word(text: str) -> bool:
    return bool(first_role(text, _WITH_UNITS)) or bool(first_role(text, ("mount", "repeat")))


def _take(part: NamePart, role: str, left: list[str]) -> str:
    part.role = role
    left.remove(role)
    return role


def _word_role(parts: Sequence[NamePart], index: int, left: Sequence[str]) -> str:
    """Return the role that the letters of a number, or the words before it, say."""
    part, before = parts[index], ""
    if index >= 2 and parts[index - 1].kind == "mark" and parts[index - 2].kind == "words":
        before = "" if parts[index - 2].varies else parts[index - 2].values[0]
    if part.prefix.lower() == "t" and "texture" in left and not _has_words(parts):
        return ""
    numeric = [role for role in (*_WITH_UNITS, "mount", "repeat") if role in left]
    return first_role(part.prefix or re.split(r"[\W_]", before)[-1], numeric)


def _has_words(parts: Sequence[NamePart]) -> bool:
    return any(part.kind == "words" and part.varies for part in parts)


def _is_short(values: Sequence[str]) -> bool:
    return all(len(value) < _DATE_DIGITS for value in values)


def _counts(values: Sequence[str]) -> bool:
    """Return whether the values are whole numbers from about 1, few of them missing."""
    if not all(value.isdecimal() for value in values):
        return False
    numbers = {int(value) for value in values}
    return min(numbers) <= _FIRST_REPEAT and max(numbers) - min(numbers) < 2 * len(numbers)


def _write(parts: Sequence[NamePart], by_path: bool) -> str:
    anything = "[^/]+?" if by_path else ".+?"  # a slash anywhere makes it a pattern of paths
    body = "".join(_expression(part, anything) for part in parts)
    return f"/{body}[.][^./]+$" if by_path else f"^{body}[.][^.]+$"


def _expression(part: NamePart, anything: str) -> str:
    if part.kind == "number":
        number = _number_expression(part.values)
        group = f"(?P<{part.role}>{number})" if part.role else number
        return f"{_literal(part.prefix)}{group}{_literal(part.suffix)}"
    if part.role:
        return f"(?P<{part.role}>{anything})"
    return _literal(part.values[0]) if not part.varies else anything


def _number_expression(values: Sequence[str]) -> str:
    sign = "-?" if any(value.startswith("-") for value in values) else ""
    decimals = "(?:[.,]\\d+)?" if any(re.search("[.,]", value) for value in values) else ""
    return rf"{sign}\d+{decimals}"


def _literal(text: str) -> str:
    """Return the text as an expression that people read; marks that act stand in []."""
    return re.sub(r"[^\w\s/\-=,#@%&~<>:;!'\"]", lambda mark: _quote(mark[0]), text)


def _quote(mark: str) -> str:
    return rf"\{mark}" if mark in "[]^\\" else f"[{mark}]"
