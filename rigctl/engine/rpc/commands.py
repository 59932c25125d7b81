"""Commands as methods, with declared types of all that clients send.

The annotations of a method declare the arguments of its command: their types, and their bounds as
``msgspec.Meta``. A number has two bounds, so that it is finite; a text has a length. Everything is
checked against them before it is used.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Awaitable, Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, TypeVar, get_type_hints

import msgspec
from msgspec import Meta

from rigctl.config.text_file import shorten
from rigctl.engine.rpc.messages import SHOWN_LETTERS
from rigctl.errors import WrongUse
from rigctl.protocol.plan import MAX_SEED
from rigctl.session.notes import MAX_AUTHOR_LETTERS, MAX_LETTERS
from rigctl.values import OWN_NAME

Result = dict[str, Any]
A_CLIENT = "a client"
"""Who sent a command that came through no connection."""
SENDER = "by"
"""The parameter of a method that gets the name of who sent the command; no client gives it."""
Word = Annotated[str, Meta(pattern=r"\A[a-z_]{1,40}\Z")]
PathText = Annotated[str, Meta(max_length=4096, pattern=r"\A[^\x00-\x1f\x7f]+\Z")]
"""A path, or a name that stands for one."""
TextureName = Annotated[str, Meta(max_length=16, pattern=r"\A\w[\w .,+()-]*\Z")]
NameText = Annotated[str, Meta(max_length=MAX_AUTHOR_LETTERS, pattern=r"\A[^\x00-\x1f\x7f]*\Z")]
"""The name of a person or a sensor, or an empty text."""
OwnName = Annotated[str, Meta(max_length=40, pattern=OWN_NAME)]
"""The name of a lab's own field."""
OwnFields = Annotated[dict[OwnName, NameText], Meta(max_length=32)]
ClientName = Annotated[str, Meta(min_length=1, max_length=80, pattern=r"\A[^\x00-\x1f\x7f]+\Z")]
"""What other clients read of one."""
NoteText = Annotated[str, Meta(max_length=MAX_LETTERS)]
"""The text of a note; what it may contain is checked where it is written."""
Seed = Annotated[int, Meta(ge=0, le=MAX_SEED)]
Number = Annotated[int, Meta(ge=0, lt=1 << 53)]
Amount = Annotated[float, Meta(ge=0, le=1e6)]

_WORDS = {"float": "a number", "int": "a whole number", "str": "a text", "array": "a list"}
_Declared = TypeVar("_Declared", bound=msgspec.Struct)


class RequestHandler(Protocol):
    """Executes the commands of an engine."""

    async def __call__(self, command: str, args: dict[str, Any], by: str = A_CLIENT) -> Result:
        """Execute a command with its arguments; ``by``: the name of who sent it."""


@dataclass(frozen=True, slots=True)
class EngineCommand:
    """One command of clients: what it does, the type of its arguments, and what executes it.

    ``execute(handler, arguments)`` returns the result. ``names_sender``: it takes ``by``, too, the
    name of who sent the command.
    """

    summary: str
    arguments: type[msgspec.Struct]
    execute: Callable[..., Awaitable[Result | None]]
    names_sender: bool = False


def declared_methods(handler: type) -> dict[str, EngineCommand]:
    """Return the commands that the ``on_`` methods of a class are, by name."""
    methods = {
        name.removeprefix("on_"): method
        for name, method in inspect.getmembers(handler, inspect.iscoroutinefunction)
        if name.startswith("on_")
    }
    return {name: _declared(name, method) for name, method in methods.items()}


def _declared(name: str, method: Callable[..., Awaitable[Result | None]]) -> EngineCommand:
    names_sender = SENDER in inspect.signature(method).parameters
    arguments = declared_arguments(name, method, told=(SENDER,))
    return EngineCommand(summary_of(method), arguments, _call(method), names_sender)


def summary_of(method: Callable[..., object]) -> str:
    """Return the first line of a method's description."""
    return (inspect.getdoc(method) or "").partition("\n")[0]


def _call(
    method: Callable[..., Awaitable[Result | None]],
) -> Callable[..., Awaitable[Result | None]]:
    """Return what calls a method of the handler with arguments by name."""
    return lambda handler, arguments, **told: method(
        handler, **arguments_by_name(arguments), **told
    )


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
