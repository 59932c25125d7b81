"""The drum's registers as values in engineering units, by the names of the register table.

A value that the table does not allow raises an error before it is sent; the board checks it as
well.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rigctl.errors import WrongUse
from rigctl.wire.drum.register_table import BY_NAME, REGISTERS, Register

MAX_WRITE = 24
"""Words of one write, so that every request stays under 64 bytes."""
MAX_READ = 40

_FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i"}


@dataclass(frozen=True, slots=True)
class RegisterWrite:
    """Neighbouring registers that one request writes; ``names`` in order of address."""

    address: int
    words: tuple[int, ...]
    names: tuple[str, ...]


def find_register(name: str) -> Register:
    """Return the table's entry of ``name``; raises WrongUse where there is none."""
    found = BY_NAME.get(name)
    if found is None:
        raise WrongUse(f"the drum has no register {name!r}: see docs/reference/drum-wire.md")
    return found


def to_raw(name: str, value: float) -> int:
    """Return the register's integer for ``value`` in engineering units.

    Raises WrongUse for a register that is not writable and for a value out of its bounds.
    """
    entry = find_register(name)
    if not entry.writable:
        raise WrongUse(f"{name} is measured by the drum and cannot be set")
    raw = round(value / entry.scale) if math.isfinite(value) else None
    if raw is None or not entry.accepts(raw):
        unit = f" {entry.unit}" if entry.unit else ""
        raise WrongUse(f"{name} cannot be {value:g}{unit}: the drum takes {_bounds(entry)}{unit}")
    return raw


def _bounds(entry: Register) -> str:
    low, high = entry.low * entry.scale, entry.high * entry.scale
    if not entry.least:
        return f"{low:g} to {high:g}"
    return f"{entry.least * entry.scale:g} to {high:g}, of either sign"


def pack_value(entry: Register, raw: int) -> tuple[int, ...]:
    """Return the register's integer as words, high word first."""
    packed = struct.pack(">" + _FORMATS[entry.kind], raw)
    return struct.unpack(f">{entry.words}H", packed)


def plan_writes(values: Mapping[str, float]) -> list[RegisterWrite]:
    """Return the fewest requests that write ``values``, neighbours in one request.

    Checks every value first; raises as :func:`to_raw`.
    """
    writes: list[RegisterWrite] = []
    for name in sorted(values, key=lambda name: find_register(name).address):
        entry = find_register(name)
        words = pack_value(entry, to_raw(name, values[name]))
        last = writes[-1] if writes else RegisterWrite(-1, (), ())
        joined = last.words + words
        if last.address + len(last.words) == entry.address and len(joined) <= MAX_WRITE:
            writes[-1] = RegisterWrite(last.address, joined, (*last.names, name))
        else:
            writes.append(RegisterWrite(entry.address, words, (name,)))
    return writes


class BlockLayout:
    """The layout of one read of ``count`` registers from ``address``.

    It holds the entries that are wholly inside the read; addresses between them are skipped.
    """

    def __init__(self, address: int, count: int, entries: Iterable[Register] = REGISTERS) -> None:
        self.address, self.count = address, count
        inside = [e for e in entries if e.address >= address and e.end <= address + count]
        self.entries = tuple(sorted(inside, key=lambda entry: entry.address))
        form, end = ">", address
        for entry in self.entries:
            form += "xx" * (entry.address - end) + _FORMATS[entry.kind] * entry.count
            end = entry.end
        self._slices: list[tuple[str, int, int]] = []
        for entry in self.entries:
            start = self._slices[-1][2] if self._slices else 0
            self._slices.append((entry.name, start, start + entry.count))
        self._words = struct.Struct(f">{count}H")
        self._values = struct.Struct(form + "xx" * (address + count - end))

    def unpack(self, words: Sequence[int]) -> dict[str, tuple[int, ...]]:
        """Return the integers of every entry by name; ValueError for a wrong number of words."""
        if len(words) != self.count:
            raise ValueError(f"expected {self.count} registers, received {len(words)}")
        numbers = self._values.unpack(self._words.pack(*words))
        return {name: numbers[start:end] for name, start, end in self._slices}

    def values(self, words: Sequence[int]) -> dict[str, float]:
        """Return every entry by name in engineering units; of an array, the first value."""
        raw = self.unpack(words)
        return {e.name: raw[e.name][0] * e.scale for e in self.entries}


def plan_reads(names: Iterable[str]) -> list[BlockLayout]:
    """Return the fewest reads of at most ``MAX_READ`` registers that hold ``names``."""
    groups: list[list[Register]] = []
    for entry in sorted(map(find_register, names), key=lambda entry: entry.address):
        if groups and entry.end - groups[-1][0].address <= MAX_READ:
            groups[-1].append(entry)
        else:
            groups.append([entry])
    return [BlockLayout(g[0].address, g[-1].end - g[0].address, g) for g in groups]
