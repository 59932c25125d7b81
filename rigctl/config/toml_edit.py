"""Changes keys in a TOML text that a person wrote, and leaves everything else as it stands."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path

from rigctl.errors import DiskFault

Value = bool | int | float | str | list[int]

_HEADER = re.compile(r"^\s*\[")


def with_keys(source: str, table: str, values: Mapping[str, Value]) -> str:
    """``source`` with these keys of ``[table]``; a key or table that is missing is added.

    Keys stand one a line, as in every rig description, but a list may go over several; a comment
    behind a changed key is kept.
    """
    lines = source.splitlines()
    first = _header_of(lines, table)
    if first is None:
        lines += ["", f"[{table}]"]
        first = len(lines) - 1
    behind = next((i for i in range(first + 1, len(lines)) if _HEADER.match(lines[i])), len(lines))
    for key, value in values.items():
        at = _line_of(lines, key, first + 1, behind)
        if at is None:
            lines.insert(first + 1, f"{key} = {_toml(value)}")
            behind += 1
        else:
            last = _end_of(lines, at)
            lines[at : last + 1] = [f"{key} = {_toml(value)}{_comment(lines[last])}"]
            behind -= last - at
    return "\n".join(lines).lstrip("\n") + "\n"


def replace_text(path: Path, text: str) -> None:
    """Put a whole text in a file's place at once. Raises DiskFault."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise DiskFault(f"{path} cannot be written ({error.strerror})") from error


def _header_of(lines: list[str], table: str) -> int | None:
    wanted = re.compile(rf"^\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?$")
    return next((i for i, line in enumerate(lines) if wanted.match(line)), None)


def _line_of(lines: list[str], key: str, first: int, behind: int) -> int | None:
    wanted = re.compile(rf"^\s*{re.escape(key)}\s*=")
    return next((i for i in range(first, behind) if wanted.match(lines[i])), None)


def _end_of(lines: list[str], first: int) -> int:
    """The line at which the value that begins in line ``first`` ends: its brackets are closed."""
    depth = 0
    for at in range(first, len(lines)):
        plain = _outside(lines[at]).partition("#")[0]
        depth += plain.count("[") - plain.count("]")
        if depth <= 0:
            return at
    return first


def _outside(line: str) -> str:
    """The line, as long as it is, with nothing in its texts that could mean something."""
    return re.sub(r'"(\\.|[^"\\])*"', lambda text: "x" * len(text.group()), line)


def _comment(line: str) -> str:
    """The comment behind a value; a # inside of a text is none."""
    outside = _outside(line)
    return f"  {line[outside.index('#') :]}" if "#" in outside else ""


def _toml(value: Value) -> str:
    return json.dumps(value, ensure_ascii=False)
