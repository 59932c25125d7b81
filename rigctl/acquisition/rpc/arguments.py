"""Declared types of what clients send: everything is checked against them before it is used.

A function's annotations declare the arguments of its command: their types, and their bounds as
``msgspec.Meta``. A number has two bounds, so that it is finite; a text has a length.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, TypeVar, get_type_hints

import msgspec
from msgspec import Meta

from rigctl.acquisition.rpc.messages import SHOWN_LETTERS
from rigctl.config.names import shorten
from rigctl.errors import WrongUse
from rigctl.protocol.plan import MAX_SEED
from rigctl.session.notes.session_note import MAX_AUTHOR_LETTERS, MAX_LETTERS

Word = Annotated[str, Meta(pattern=r"\A[a-z_]{1,40}\Z")]
PathText = Annotated[str, Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f]+\Z")]
"""A path, or a name that stands for one."""
TextureName = Annotated[str, Meta(max_length=16, pattern=r"\A\w[\w .,+()-]*\Z")]
NameText = Annotated[str, Meta(max_length=MAX_AUTHOR_LETTERS, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
"""The name of a person or a sensor, or an empty text."""
ClientName = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"\A[^\x00-\x1f\x7f]+\Z")]
"""What other clients read of one."""
NoteText = Annotated[str, Meta(max_length=MAX_LETTERS)]
"""The text of a note; what it may contain is checked where it is written."""
Seed = Annotated[int, Meta(ge=0, le=MAX_SEED)]
Number = Annotated[int, Meta(ge=0, lt=1 << 53)]
Amount = Annotated[float, Meta(ge=0, le=1e6)]

_WORDS = {"float": "a number", "int": "a whole number", "str": "a text", "array": "a list"}
_Declared = TypeVar("_Declared", bound=msgspec.Struct)


def declared_arguments(
    name: str, function: Callable[..., object], told: Collection[str] = ()
) -> type[msgspec.Struct]:
    """Return the type of a function's arguments by name; those without a default are required.

    ``told``: parameters that no client gives.
    """
    hints = get_type_hints(function, include_extras=True)
    parameters = inspect.signature(function).parameters
    fields = [
        (name, hints[name], ... if parameter.default is parameter.empty else parameter.default)
        for name, parameter in parameters.items()
        if name not in ("self", *told)
    ]
    required: list[Any] = [field[:2] for field in fields if field[2] is ...]
    optional = [field for field in fields if field[2] is not ...]
    return msgspec.defstruct(
        name, required + optional, kw_only=True, frozen=True, forbid_unknown_fields=True
    )


def read_arguments(what: str, kind: type[_Declared], args: Mapping[str, Any]) -> _Declared:
    """Return the arguments as their type. Raises WrongUse where they do not fit it."""
    try:
        return msgspec.convert(args, kind)
    except msgspec.ValidationError as error:
        names = ", ".join(kind.__struct_fields__) or "no arguments"
        raise WrongUse(f"{what}: {_sentence(error)}; it takes {names}") from error


def arguments_by_name(arguments: msgspec.Struct) -> dict[str, Any]:
    """Return the values of a declared type's fields."""
    return {name: getattr(arguments, name) for name in arguments.__struct_fields__}


def _sentence(error: msgspec.ValidationError) -> str:
    """Return what does not fit, with the argument first."""
    what, _, place = str(error).replace("`", "").partition(" - at ")
    what = shorten(what[0].lower() + what[1:], SHOWN_LETTERS)
    for name, word in _WORDS.items():
        what = re.sub(rf"\b{name}\b", word, what)
    place = shorten(place.removeprefix("$").removeprefix("."), SHOWN_LETTERS)
    return f"{place}: {what}" if place else what
