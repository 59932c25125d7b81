"""Commands as methods: the name, the summary and the types of a command's arguments."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec

from rigctl.acquisition.rpc.arguments import arguments_by_name, declared_arguments

Result = dict[str, Any]
A_CLIENT = "a client"
"""Who sent a command that came through no connection."""
SENDER = "by"
"""The parameter of a method that gets the name of who sent the command; no client gives it."""


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
