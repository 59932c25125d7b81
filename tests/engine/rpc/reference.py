"""The tables of docs/reference/engine.md. ``python -m tests.engine.rpc.reference`` prints."""

from __future__ import annotations

import inspect
import math

import msgspec
from msgspec.inspect import (
    BoolType,
    CollectionType,
    DictType,
    EnumType,
    FloatType,
    IntType,
    LiteralType,
    NoneType,
    StrType,
    Type,
    UnionType,
    VarTupleType,
    type_info,
)

from rigctl.bench.simulated_rig import FaultInjection
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.rpc.commands import (
    EngineCommand,
    declared_arguments,
    declared_methods,
    summary_of,
)
from rigctl.engine.rpc.server import ClientCommands
from rigctl.finger.bench.virtual import FingerFaults
from rigctl.finger.commands import FingerCommands

HEAD = ["| command | arguments | what it does |", "|---|---|---|"]


def tables() -> dict[str, str]:
    """Return the rows of each table by its title."""
    return {
        "Commands about the clients": commands(declared_methods(ClientCommands)),
        "Commands of the drum's engine": commands(DrumCommands.declared_commands()),
        "Commands of the finger's engine": commands(FingerCommands.declared_commands()),
        "Faults of the simulated drum": faults(FaultInjection),
        "Faults of the virtual finger": faults(FingerFaults),
    }


def commands(declared: dict[str, EngineCommand]) -> str:
    rows = [
        f"| `{name}` | {arguments(command.arguments)} | {_markdown(command.summary)} |"
        for name, command in sorted(declared.items())
    ]
    return "\n".join([*HEAD, *rows])


def faults(injection: type) -> str:
    rows = []
    for name, method in inspect.getmembers(injection, inspect.isfunction):
        if not name.startswith("_"):
            types = arguments(declared_arguments(name, method))
            rows.append(f"| `{name}` | {types} | {_markdown(summary_of(method))} |")
    return "\n".join([HEAD[0].replace("command", "fault"), HEAD[1], *rows])


def arguments(kind: type[msgspec.Struct]) -> str:
    """Return what the fields of a declared type may be."""
    info = type_info(kind)
    return "; ".join(
        f"`{field.name}`: {words(field.type)}{'' if field.required else _default(field.default)}"
        for field in info.fields
    )


def words(info: Type) -> str:
    """Return a type and its bounds in words."""
    match info:
        case BoolType():
            return "true or false"
        case NoneType():
            return "null"
        case IntType():
            return f"whole number {_bounds(info.ge, info.gt, info.le, info.lt)}"
        case FloatType():
            return f"number {_bounds(info.ge, info.gt, info.le, info.lt)}"
        case StrType():
            return f"text of up to {info.max_length} letters" if info.max_length else "word"
        case LiteralType():
            return " or ".join(f"`{value}`" for value in info.values)
        case EnumType():
            return f"number of a {info.cls.__name__.lower()}"
        case DictType():
            of = f"{words(info.key_type)}, {words(info.value_type)}"
            return f"object of up to {info.max_length}: {of}"
        case VarTupleType() | CollectionType():
            return f"list of up to {info.max_length}: {words(info.item_type)}"
        case UnionType():
            return " or ".join(words(kind) for kind in info.types if not isinstance(kind, NoneType))
    raise TypeError(info)


def _default(value: object) -> str:
    if value in (None, (), {}):
        return " (optional)"
    return f" (default {str(value).lower()})"


def _markdown(text: str) -> str:
    return text.replace("``", "`")


def _bounds(ge: float | None, gt: float | None, le: float | None, lt: float | None) -> str:
    low = f"from {ge:g}" if ge is not None else f"above {gt:g}"
    top = le if le is not None else lt
    assert top is not None
    power = round(math.log2(top + (le is not None))) if top > 1e9 else 0
    high = f"2^{power}" if power and 2**power in (top, top + 1) else f"{top:g}"
    return f"{low} {'to' if le is not None and not power else 'to below'} {high}"


if __name__ == "__main__":
    for title, table in tables().items():
        print(f"## {title}\n\n{table}\n")
