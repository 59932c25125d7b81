"""The drum's registers to engineering units and back, by the names of the register table.

Numbers in, words out, and the other way round. A value that the table does not allow is refused
here in a sentence, before it reaches the wire; the board refuses it again by itself.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rigctl.errors import WrongUse
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, REGISTERS

LONGEST_WRITE = 24
"""Words that one write may hold, so that every request stays under 64 bytes."""

_FORMATS = {"u16": "H", "i16": "h", "u32": "I", "i32": "i"}


@dataclass(frozen=True, slots=True)
class Write:
    """Neighbouring registers that one request writes; ``names`` in order of address."""

    address: int
    words: tuple[int, ...]
    names: tuple[str, ...]


def register(name: str) -> Register:
    """The table's entry of ``name``; WrongUse where there is none."""
    found = BY_NAME.get(name)
    if found is None:
        raise WrongUse(f"the drum has no register {name!r}: see docs/reference/drum-wire.md")
    return found


def to_raw(name: str, value: float) -> int:
    """The integer on the wire for ``value`` in engineering units.

    Raises WrongUse for a register that is not writable and for a value out of its bounds.
    """
    entry = register(name)
    if not entry.writable:
        raise WrongUse(f"{name} is measured by the drum and cannot be set")
    raw = round(value / entry.scale) if math.isfinite(value) else None
    if raw is None or not entry.accepts(raw):
        unit = f" {entry.unit}" if entry.unit else ""
        raise WrongUse(f"{name} cannot be {value:g}{unit}: the drum takes {bounds(entry)}{unit}")
    return raw


def bounds(entry: Register) -> str:
    """What may be written, in engineering units, as words."""
    low, high = entry.low * entry.scale, entry.high * entry.scale
    if not entry.least:
        return f"{low:g} to {high:g}"
    return f"{entry.least * entry.scale:g} to {high:g}, of either sign"


def words_of(entry: Register, raw: int) -> tuple[int, ...]:
    """The register's integer as words, high word first."""
    packed = struct.pack(">" + _FORMATS[entry.kind], raw)
    return struct.unpack(f">{entry.words}H", packed)


def to_words(name: str, value: float) -> tuple[int, ...]:
    """Words on the wire for ``value`` in engineering units; refuses as :func:`to_raw`."""
    return words_of(register(name), to_raw(name, value))


def plan_writes(values: Mapping[str, float]) -> list[Write]:
    """The fewest requests that write ``values``, neighbours together.

    Every value is checked before anything is planned; refuses as :func:`to_raw`.
    """
    writes: list[Write] = []
    for name in sorted(values, key=lambda name: register(name).address):
        address, words = register(name).address, to_words(name, values[name])
        last = writes[-1] if writes else None
        if last and last.address + len(last.words) == address and _fits(last, words):
            writes[-1] = Write(last.address, last.words + words, (*last.names, name))
        else:
            writes.append(Write(address, words, (name,)))
    return writes


def _fits(write: Write, words: tuple[int, ...]) -> bool:
    return len(write.words) + len(words) <= LONGEST_WRITE


class BlockLayout:
    """How one read of ``count`` registers from ``address`` is taken apart.

    Only entries that lie wholly inside the read are seen; addresses between them are skipped.
    """

    def __init__(self, address: int, count: int, entries: Iterable[Register] = REGISTERS) -> None:
        self.address, self.count = address, count
        inside = [e for e in entries if e.address >= address and e.end <= address + count]
        self.entries = tuple(sorted(inside, key=lambda entry: entry.address))
        form, at = ">", address
        for entry in self.entries:
            form += "xx" * (entry.address - at) + _FORMATS[entry.kind] * entry.count
            at = entry.end
        self._absent = [(entry.name, (0,) * entry.count) for entry in self.entries]
        self._places: list[tuple[str, int, int]] = []
        for entry in self.entries:
            first = self._places[-1][2] if self._places else 0
            self._places.append((entry.name, first, first + entry.count))
        self._words = struct.Struct(f">{count}H")
        self._values = struct.Struct(form + "xx" * (address + count - at))

    def raw(self, words: Sequence[int]) -> dict[str, tuple[int, ...]]:
        """The integers of every entry by name; ValueError where the count of words is wrong."""
        if len(words) != self.count:
            raise ValueError(f"{self.count} registers were asked for and {len(words)} came")
        numbers = self._values.unpack(self._words.pack(*words))
        return {name: numbers[first:end] for name, first, end in self._places}

    def words(self, raw: Mapping[str, Sequence[int]]) -> tuple[int, ...]:
        """The words that :meth:`raw` takes apart; what ``raw`` does not name is 0."""
        numbers = [n for name, zeros in self._absent for n in raw.get(name, zeros)]
        return self._words.unpack(self._values.pack(*numbers))

    def values(self, words: Sequence[int]) -> dict[str, float]:
        """Every entry by name in engineering units; of several, the first."""
        raw = self.raw(words)
        return {e.name: raw[e.name][0] * e.scale for e in self.entries}


def reads_for(names: Iterable[str], longest: int = 40) -> list[BlockLayout]:
    """The fewest reads of at most ``longest`` registers that hold ``names``."""
    layouts: list[BlockLayout] = []
    group: list[Register] = []
    for entry in sorted((register(name) for name in names), key=lambda e: e.address):
        if group and entry.end - group[0].address > longest:
            layouts.append(_layout(group))
            group = []
        group.append(entry)
    return [*layouts, _layout(group)] if group else layouts


def _layout(group: list[Register]) -> BlockLayout:
    first, end = group[0].address, max(entry.end for entry in group)
    return BlockLayout(first, end - first, group)
