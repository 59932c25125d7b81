"""The lines of a TOML text's keys and tables, for messages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator

from rigctl.config.toml_bounds import MAX_DEPTH, KeyPath

_HEADER = re.compile(r"\s*+\[\[?(?P<name>[^\[\]]++)\]\]?\s*+(#.*)?")
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
        if header := _HEADER.fullmatch(line):
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
