"""Commands as methods: the name, the summary and the types of a command's arguments."""

from __future__ import annotations

import inspect
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import msgspec

from rigctl.acquisition.rpc.arguments import arguments_by_name, declared_arguments

Result = dict[str, Any]


@dataclass(frozen=True, slots=True)
class EngineCommand:
    """One command of clients: what it does, the type of its arguments, and what executes it.

    ``execute(handler, arguments)`` returns the result.
    """

    summary: str
    arguments: type[msgspec.Struct]
    execute: Callable[[Any, Any], Awaitable[Result | None]]


def declared_methods(handler: type) -> dict[str, EngineCommand]:
    """Return the commands that the ``on_`` methods of a class are, by name."""
    methods = {
        name.removeprefix("on_"): method
        for name, method in inspect.getmembers(handler, inspect.iscoroutinefunction)
        if name.startswith("on_")
    }
    return {
        name: EngineCommand(summary_of(method), declared_arguments(name, method), _call(method))
        for name, method in methods.items()
    }


def summary_of(method: Callable[..., object]) -> str:
    """Return the first line of a method's description."""
    return (inspect.getdoc(method) or "").partition("\n")[0]


def _call(
    method: Callable[..., Awaitable[Result | None]],
) -> Callable[[Any, msgspec.Struct], Awaitable[Result | None]]:
    """Return what calls a method of the handler with arguments by name."""
    return lambda handler, arguments: method(handler, **arguments_by_name(arguments))
