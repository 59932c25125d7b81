"""Wrong requests by the thousand: every command with arguments of every wrong kind."""

from __future__ import annotations

import asyncio
import inspect
import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from random import Random
from typing import Any

from rigctl.engine.engine_commands import EngineCommands
from rigctl.engine.rpc.commands import declared_arguments, declared_methods
from rigctl.engine.rpc.server import ClientCommands

BATCH = 50
TOKENS = (b'"', b"{", b"}", b"[", b"]", b":", b",", b"null", b"1e9", b"-0", b"\\u0000", b"\xc3")
Arguments = Mapping[str, Collection[str]]

VALUES = [
    *("null", "true", "false", "[]", "{}", '""', '"A\\u0000"', '"../../x"', '"\\u001b[2J"'),
    *("NaN", "Infinity", "-Infinity", "1e999", "-1e308", "1e308", "-1", "0.5", "9007199254740993"),
    *("1" + "0" * 400, "-1" + "0" * 400, "18446744073709551615", "-9223372036854775809"),
    *("[" * 40_000, '{"a":' * 9_000, "[[[]]]", '{"a":{"b":[]}}', '"' + "n" * 60_000 + '"'),
    *('"\\ud800"', '"é"', '"fast"', "[1,2,99]", '["train"]', '{"fault":"push"}', "1.5e-320"),
]
"""JSON as a client may write it, some of it no JSON."""

ENVELOPES = [
    '{"id":VALUE,"command":"status"}',
    '{"id":1,"command":VALUE}',
    '{"id":1,"command":"status","args":VALUE}',
    '{"id":1,"command":"status","args":{"a":VALUE}}',
    '{"id":1,"command":"status",VALUE:1}',
    '{"reply":VALUE}',
    "VALUE",
    "VALUEVALUE",
]


def wrong_requests(commands: Arguments, faults: Arguments) -> Iterator[bytes]:
    """Yield lines: each argument of each command and fault with each value, then envelopes.

    Some are right by chance, such as a jog of 0.5 mm; none of those ends what the rig does, so
    that no fault is switched on, no end switch held, and the computer not stalled.
    """
    for command, names in commands.items():
        for name in (*names, "surplus"):
            for value in VALUES:
                yield request_line(1, command, **{name: value})
        for value in VALUES if names else ():
            yield request_line(1, command, **dict.fromkeys(names, value))
    for fault, names in faults.items():
        for name in {*names, "surplus"} - {"on", "upper", "lower", "stall_s"}:
            for value in VALUES:
                yield request_line(1, "inject", fault=json.dumps(fault), **{name: value})
    for value in VALUES:
        yield request_line(1, "inject", fault=value)
        for envelope in ENVELOPES:
            yield envelope.replace("VALUE", value).encode("utf-8", "surrogatepass") + b"\n"


def mutated(lines: Sequence[bytes], random: Random) -> Iterator[bytes]:
    """Yield lines with bytes changed, left out, doubled, or the end of another line, for ever."""
    while True:
        line = bytearray(random.choice(lines)[:-1])
        for _ in range(random.randint(1, 4)):
            at = random.randrange(len(line) + 1)
            match random.randrange(5):
                case 0:
                    line[at : at + 1] = bytes([random.randrange(256)])
                case 1:
                    del line[at : at + random.randint(1, 9)]
                case 2:
                    line[at:at] = line[at : at + random.randint(1, 9)]
                case 3:
                    line[at:] = random.choice(lines)[:-1][at:]
                case _:
                    line[at:at] = random.choice(TOKENS)
        yield bytes(line).replace(b"\n", b" ") + b"\n"


def request_line(number: int, command: str, /, **args: str) -> bytes:
    """Return the line of a request; the arguments are JSON already."""
    inside = ",".join(f"{json.dumps(name)}:{value}" for name, value in args.items())
    return f'{{"id":{number},"command":{json.dumps(command)},"args":{{{inside}}}}}\n'.encode()


def declared(handler: type[EngineCommands[Any]], faults: type) -> tuple[Arguments, Arguments]:
    """Return the names of all arguments, of the commands and of the faults."""
    commands = (declared_methods(ClientCommands) | handler.declared_commands()).items()
    methods = inspect.getmembers(faults, inspect.isfunction)
    return (
        {name: command.arguments.__struct_fields__ for name, command in commands},
        {
            name: declared_arguments(name, method).__struct_fields__
            for name, method in methods
            if not name.startswith("_")
        },
    )


class Attacker:
    """A client that knows the token and writes lines as they are."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.sent = 0
        self.refusals: list[str] = []
        self._reader, self._writer = reader, writer
        self._number = 1000

    @classmethod
    async def connect(cls, address: tuple[str, int], token: str = "token") -> Attacker:
        """Connect and log in."""
        attacker = cls(*await asyncio.open_connection(*address))
        attacker._writer.write(json.dumps({"token": token}).encode() + b"\n")
        return attacker

    async def request(self, command: str, **args: object) -> None:
        """Send a right request and wait for its good reply."""
        self._number += 1
        values = {name: json.dumps(value) for name, value in args.items()}
        self._writer.write(request_line(self._number, command, **values))
        while (message := await self._next()).get("reply") != self._number:
            if message.get("ok") is False:
                self.refusals.append(f"{message['exit_code']} {message['error']}")
        assert message["ok"], message

    async def attack(self, lines: Iterable[bytes]) -> None:
        """Send the lines, some at a time with a right request behind them."""
        source = iter(lines)
        while batch := list(islice(source, BATCH)):
            self.sent += len(batch)
            self._writer.writelines(batch)
            await self.request("status")

    async def close(self) -> None:
        """Leave."""
        self._writer.close()
        await self._writer.wait_closed()

    def require_refusals(self) -> None:
        """Require that nearly all lines were refused and that none failed inside."""
        assert len(self.refusals) > 0.9 * self.sent > 1000
        assert not [text for text in self.refusals if "failed inside" in text]
        assert {text[0] for text in self.refusals} <= {"2", "3"}

    async def _next(self) -> dict[str, Any]:
        line = await self._reader.readline()
        assert line, "the engine has closed the connection"
        return dict(json.loads(line))
