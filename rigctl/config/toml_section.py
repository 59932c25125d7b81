"""Dataclasses that mirror a TOML table: each field declares unit, range and meaning of its key."""

from __future__ import annotations

from dataclasses import field, fields
from typing import TYPE_CHECKING, Any, TypeVar

from rigctl.config.toml_reader import TomlTable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

_Section = TypeVar("_Section", bound="DataclassInstance")


def number(
    default: float | tuple[float, ...], unit: str, low: float, high: float, doc: str = ""
) -> Any:
    """Declare a number, a whole number or a tuple of either; the annotation says which.

    Numbers in a tuple of floats are different.
    """
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "doc": doc})


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


def flag(default: bool, doc: str) -> Any:
    """Declare true or false."""
    return field(default=default, metadata={"unit": "", "doc": doc})


def read_section(table: TomlTable, kind: type[_Section]) -> _Section:
    """Return the dataclass ``kind`` with the table's values; a missing key has its default.

    Raises the error of the table's text for an unknown key or an invalid value.
    """
    values = {f.name: _read_value(table, f) for f in fields(kind)}
    table.finish()
    return kind(**values)


def _read_value(table: TomlTable, item: Any) -> Any:
    meta, default = item.metadata, item.default
    if isinstance(default, bool):
        return table.flag(item.name, default)
    if isinstance(default, str):
        if meta["choices"]:
            return table.choice(item.name, meta["choices"], default)
        return table.text(item.name, default)
    if "longest_bytes" in meta:
        most, longest_bytes = meta["most"], meta["longest_bytes"]
        return table.names(item.name, most=most, longest_bytes=longest_bytes, may_be_empty=True)
    if item.type == "tuple[str, ...]":
        return _read_texts(table, item)
    if item.type == "tuple[float, ...]":
        given = table.numbers(item.name, unit=meta["unit"], low=meta["low"], high=meta["high"])
        return given or default
    if isinstance(default, tuple):
        return table.integers(item.name, default, low=meta["low"], high=meta["high"])
    if item.type == "int":
        return table.integer(item.name, default, low=meta["low"], high=meta["high"])
    return table.number(item.name, default, unit=meta["unit"], low=meta["low"], high=meta["high"])


def _read_texts(table: TomlTable, item: Any) -> tuple[str, ...]:
    if item.name not in table:
        default: tuple[str, ...] = item.default
        return default
    given, choices = table.texts(item.name), item.metadata["choices"]
    for value in given:
        if value not in choices:
            table.fail(item.name, f"{value!r} is none of {', '.join(choices)}")
    return given
