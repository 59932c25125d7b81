"""Wrong requests by the thousand: every command with arguments of every wrong kind."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator

from rigctl.acquisition.rpc.messages import EngineRequest

VALUES = [
    *("null", "true", "false", "[]", "{}", '""', '"A\\u0000"', '"../../x"', '"\\u001b[2J"'),
    *("NaN", "Infinity", "-Infinity", "1e999", "-1e308", "1e308", "-1", "0.5", "9007199254740993"),
    *("1" + "0" * 400, "-1" + "0" * 400, "18446744073709551615", "-9223372036854775809"),
    *("[" * 40_000, '{"a":' * 9_000, "[[[]]]", '{"a":{"b":[]}}', '"' + "n" * 60_000 + '"'),
    *('"\\ud800"', '"é"', '"fast"', "[1,2,3]", '["train"]', '{"fault":"push"}', "1.5e-320"),
]
"""JSON as a client may write it, some of it no JSON."""

ENVELOPES = [
    '{{"id":{v},"command":"status"}}',
    '{{"id":1,"command":{v}}}',
    '{{"id":1,"command":"status","args":{v}}}',
    '{{"id":1,"command":"status","args":{{"a":{v}}}}}',
    '{{"id":1,"command":"status","{{":{v}}}',
    '{{"reply":{v}}}',
    "{v}",
    "{v}{v}",
]


def wrong_requests(
    commands: dict[str, Collection[str]], faults: dict[str, Collection[str]]
) -> Iterator[bytes]:
    """Yield lines: each argument of each command and fault with each value, then envelopes."""
    for command, names in commands.items():
        for name in (*names, "surplus"):
            for value in VALUES:
                yield _line(command, {name: value})
                yield _line(command, dict.fromkeys(names, value))
    for fault, names in faults.items():
        for name in (*names, "surplus"):
            for value in VALUES:
                yield _line("inject", {"fault": json.dumps(fault), name: value})
    for value in VALUES:
        yield _line("inject", {"fault": value})
        for envelope in ENVELOPES:
            yield envelope.format(v=value).encode() + b"\n"


def _line(command: str, args: dict[str, str]) -> bytes:
    inside = ",".join(f"{json.dumps(name)}:{value}" for name, value in args.items())
    return f'{{"id":1,"command":{json.dumps(command)},"args":{{{inside}}}}}\n'.encode()


def status_request(number: int) -> bytes:
    """Return the line of a right request."""
    return json.dumps({"id": number, "command": "status"}).encode() + b"\n"


__all__ = ["EngineRequest", "status_request", "wrong_requests"]
