"""Edit keys of a TOML file that a person wrote, and keep everything else as it is."""

from __future__ import annotations

import io
import os
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any, NamedTuple

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array, String, StringType, Trivia

from rigctl.config.toml_reader import TEXTS_AND_COMMENTS, KeyPath
from rigctl.errors import DiskFault, WrongUse

_HEADER = re.compile(r"\s*\[")
_ANY = re.compile(r"[^\n]")


class TomlChunk(NamedTuple):
    """The lines before the first header, or a header with all that follows; ``path`` is its own."""

    path: tuple[str, ...]
    is_repeated: bool
    text: str

    @property
    def body(self) -> str:
        """The lines without the white space at the end."""
        return self.text.rstrip()

    @property
    def space(self) -> str:
        """The white space at the end."""
        return self.text[len(self.body) :]

    def with_body(self, body: str) -> TomlChunk:
        """Return the chunk with other lines before the same white space."""
        return self._replace(text=body + self.space)


def split_chunks(source: str) -> list[TomlChunk]:
    """Return the chunks of a valid TOML text; the first one is that of the root."""
    lines = list(io.StringIO(source, newline="\n"))
    starts = [(_first_comment(lines, number), number) for number in _headers(source)]
    ends = [start for start, _ in starts[1:]] + [len(lines)]
    first = starts[0][0] if starts else len(lines)
    chunks = [TomlChunk((), False, "".join(lines[:first]))]
    for (start, number), end in zip(starts, ends, strict=False):
        path, is_repeated = _read_header(lines[number])
        chunks.append(TomlChunk(path, is_repeated, "".join(lines[start:end])))
    return chunks


def join_chunks(chunks: list[TomlChunk]) -> str:
    """Return the text of chunks; each begins on a line of its own."""
    texts = [chunk.text for chunk in chunks if chunk.text]
    whole = [text if text.endswith("\n") else f"{text}\n" for text in texts[:-1]]
    return "".join([*whole, *texts[-1:]])


def _headers(source: str) -> Iterator[int]:
    """Yield the numbers of the lines, from 0, that are headers of tables."""
    plain = TEXTS_AND_COMMENTS.sub(lambda found: _ANY.sub("x", found[0]), source)
    plain_comments = TEXTS_AND_COMMENTS.sub(_blank, source)
    depth = 0
    for number, (line, code) in enumerate(
        zip(plain.split("\n"), plain_comments.split("\n"), strict=True)
    ):
        if depth == 0 and _HEADER.match(line):
            yield number
        else:
            depth += sum(map(code.count, "[{")) - sum(map(code.count, "]}"))


def _blank(found: re.Match[str]) -> str:
    return _ANY.sub(" ", found[0])


def _first_comment(lines: list[str], header: int) -> int:
    """Return the first of the lines of comment directly above a header."""
    while header and lines[header - 1].lstrip().startswith("#"):
        header -= 1
    return header


def _read_header(line: str) -> tuple[tuple[str, ...], bool]:
    table: Any = tomllib.loads(line)
    path: list[str] = []
    while isinstance(table, dict) and table:
        key, table = next(iter(table.items()))
        path.append(key)
    return tuple(path), isinstance(table, list)


Item = bool | int | float | str
Value = Item | list[int] | list[Item]
Data = dict[str, Any]
_UNUSUAL = "is written in a way that a form cannot change: change it as text"


def set_keys(source: str, table: str, values: Mapping[str, Value]) -> str:
    """Return ``source`` with these keys of ``[table]`` set; missing keys and tables are added.

    Comments, order and layout of everything else stay. ``source`` must be valid TOML.
    """
    document = tomlkit.parse(source)
    if table not in document:
        document[table] = tomlkit.table()
    section = document[table]
    for key, value in values.items():
        section[key] = value
    return document.as_string()


def set_key(source: str, path: KeyPath, value: Value | None) -> str:
    """Return ``source`` with one key set; None leaves the key out.

    ``path`` is that of a key in the root, in a table, or in one of repeated tables. Everything
    else stays, also the comments in a list. Raises WrongUse where this cannot be done.
    """
    *tables, key = path
    name = str(key)

    def change(data: Any) -> None:
        for part in tables:
            data = data.setdefault(part, {}) if isinstance(part, str) else data[part]
        if value is None:
            data.pop(name, None)
        else:
            data[name] = value

    return _checked(source, change, lambda: _edit_chunk(source, tuple(tables), name, value))


def insert_table(source: str, name: str, place: int, values: Mapping[str, Value]) -> str:
    """Return ``source`` with one more of the repeated tables ``name``, which gets that place."""

    def change(data: Data) -> None:
        data.setdefault(name, []).insert(place, dict(values))

    def edited() -> str:
        chunks = split_chunks(source)
        places = _places(chunks, name)
        at = places[place - 1] + 1 if place and places else (places or [len(chunks)])[0]
        lines = tomlkit.dumps({name: [dict(values)]}).strip("\n")
        return _insert(chunks, at, TomlChunk((name,), True, lines))

    return _checked(source, change, edited)


def remove_table(source: str, name: str, place: int) -> str:
    """Return ``source`` without one of the repeated tables ``name``; later comments stay."""

    def change(data: Data) -> None:
        del data[name][place]
        if not data[name]:
            del data[name]

    def edited() -> str:
        chunks = split_chunks(source)
        at = _places(chunks, name)[place]
        chunks[at] = chunks[at]._replace(text=_later_comments(chunks[at].text))
        return join_chunks(chunks)

    return _checked(source, change, edited)


def swap_tables(source: str, name: str, place: int) -> str:
    """Return ``source`` with one of the repeated tables ``name`` behind the next one."""

    def change(data: Data) -> None:
        data[name].insert(place + 1, data[name].pop(place))

    def edited() -> str:
        chunks = split_chunks(source)
        first, second = _places(chunks, name)[place : place + 2]
        one, other = chunks[first], chunks[second]
        chunks[first], chunks[second] = one.with_body(other.body), other.with_body(one.body)
        return join_chunks(chunks)

    return _checked(source, change, edited)


def _checked(source: str, change: Callable[[Data], None], edited: Callable[[], str]) -> str:
    """Return an edited text, after a check that it holds what ``change`` makes of the data."""
    expected = tomllib.loads(source)
    change(expected)
    try:
        text = edited()
        found = tomllib.loads(text)
    except (TOMLKitError, ValueError, KeyError, IndexError, TypeError) as error:
        raise WrongUse(f"this {_UNUSUAL}") from error
    if _without_empty(found) != _without_empty(expected):
        raise WrongUse(f"this {_UNUSUAL}")
    return text


def _without_empty(data: Data) -> Data:
    return {key: value for key, value in data.items() if value != {}}


def _edit_chunk(source: str, tables: KeyPath, key: str, value: Value | None) -> str:
    chunks = split_chunks(source)
    at = _chunk_of(chunks, tables)
    if at is None:
        if value is None:
            return source
        first = _first_repeated(chunks)
        name = str(tables[0])
        lines = tomlkit.dumps({name: {key: value}}).strip("\n")
        return _insert(chunks, first, TomlChunk((name,), False, lines))
    line_end = "\r\n" if "\r\n" in chunks[at].text else "\n"
    document = tomlkit.parse(chunks[at].body.replace("\r\n", "\n") + "\n")
    section: Any = document
    for part in tables:
        section = section[part if isinstance(part, str) or not chunks[at].is_repeated else 0]
    _set(section, key, value)
    text = document.as_string().rstrip("\n").replace("\n", line_end)
    is_last = at == len(chunks) - 1
    space = chunks[at].space or ("\n" if is_last else "\n\n")
    chunks[at] = chunks[at]._replace(text=text + space)
    return join_chunks(chunks)


def _set(section: Any, key: str, value: Value | None) -> None:
    if value is None:
        section.pop(key, None)
    elif isinstance(value, list) and isinstance(section.get(key), Array) and section[key]:
        _set_items(section[key], value)
    else:
        section[key] = _lines(value) if isinstance(value, str) and "\n" in value else value


def _lines(value: str) -> String:
    """Return a text of several lines, each on its own in the file."""
    escaped = tomlkit.string(value, multiline=True).as_string()[3:-3]
    return String(StringType.MLB, value, f"\n{escaped}", Trivia())


def _set_items(array: Array, values: list[Any]) -> None:
    """Change a list where it differs, so that the comments of its other items stay."""
    before = array.unwrap()
    matcher = SequenceMatcher(None, list(map(repr, before)), list(map(repr, values)), False)
    for _, start, end, first, last in reversed(matcher.get_opcodes()):
        common = min(end - start, last - first)
        for offset in range(common):
            array[start + offset] = values[first + offset]
        for place in reversed(range(start + common, end)):
            del array[place]
        for offset in range(common, last - first):
            array.insert(start + offset, values[first + offset])


def _chunk_of(chunks: list[TomlChunk], tables: KeyPath) -> int | None:
    """Return the chunk that has a table's keys, the root's if the table is written there."""
    if not tables:
        return 0
    name = str(tables[0])
    if len(tables) == 2:
        return _places(chunks, name)[int(tables[1])]
    for place, chunk in enumerate(chunks):
        if chunk.path == (name,):
            return place
    return 0 if name in tomllib.loads(chunks[0].text) else None


def _places(chunks: list[TomlChunk], name: str) -> list[int]:
    return [at for at, chunk in enumerate(chunks) if chunk.path == (name,) and chunk.is_repeated]


def _first_repeated(chunks: list[TomlChunk]) -> int:
    return next((at for at, chunk in enumerate(chunks) if chunk.is_repeated), len(chunks))


def _insert(chunks: list[TomlChunk], at: int, chunk: TomlChunk) -> str:
    """Return the text with one more chunk, an empty line before it and behind it."""
    before = chunks[:at]
    if any(earlier.text for earlier in before):
        last = max(place for place, earlier in enumerate(before) if earlier.text)
        before[last] = before[last]._replace(text=before[last].body + "\n\n")
    later = chunks[at:]
    space = "\n\n" if any(following.text for following in later) else "\n"
    return join_chunks([*before, chunk._replace(text=chunk.body + space), *later])


def _later_comments(text: str) -> str:
    """Return the comments at the end of a table that an empty line separates from it."""
    lines = text.splitlines(keepends=True)
    first = len(lines)
    while first and (not lines[first - 1].strip() or lines[first - 1].lstrip().startswith("#")):
        first -= 1
    empty = next((at for at in range(first, len(lines)) if not lines[at].strip()), len(lines))
    kept = "".join(lines[empty:])
    return kept.lstrip("\r\n") if kept.strip() else ""


def replace_file(path: Path, text: str) -> None:
    """Replace a file's text in one step; a link and who may write it stay. Raises DiskFault."""
    file = Path(os.path.realpath(path))
    partial = file.with_name(f"{file.name}.partial")
    try:
        with partial.open("w", encoding="utf-8", newline="") as new:
            new.write(text)
            new.flush()
            os.fsync(new.fileno())  # a power cut must not leave an empty file
        if file.exists():
            shutil.copymode(file, partial)
        partial.replace(file)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise DiskFault(f"{path} cannot be written ({error.strerror})") from error
