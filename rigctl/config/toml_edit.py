"""Edit keys of a TOML file that a person wrote, and keep everything else as it is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import tomlkit

from rigctl.errors import DiskFault

Value = bool | int | float | str | list[int]


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


def replace_file(path: Path, text: str) -> None:
    """Replace a file's text in one step. Raises DiskFault."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise DiskFault(f"{path} cannot be written ({error.strerror})") from error
