"""The chunks of a TOML text: each table with its header and the comments directly above it.

A chunk can be edited, moved or left out without a change of what stands elsewhere.
"""

from __future__ import annotations

import io
import re
import tomllib
from collections.abc import Iterator
from typing import Any, NamedTuple

from rigctl.config.toml_bounds import TEXTS_AND_COMMENTS

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
