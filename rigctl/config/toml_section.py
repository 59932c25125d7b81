"""Dataclasses that mirror a TOML table: each field declares unit, range and meaning of its key."""

from __future__ import annotations

from dataclasses import field, fields
from typing import TYPE_CHECKING, Any, TypeVar

from rigctl.config.toml_field import FieldType, TomlField
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
    return _TYPES[item.type]


_TYPES = {
    "int": FieldType.INTEGER,
    "float": FieldType.NUMBER,
    "tuple[str, ...]": FieldType.CHOICES,
    "tuple[int, ...]": FieldType.INTEGERS,
    "tuple[float, ...]": FieldType.NUMBERS,
}
