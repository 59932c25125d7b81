"""The virtual drum's registers: words by address, bounds on writes, all-or-nothing writes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

from rigctl.wire.drum_map import (
    BY_NAME,
    COUNTERS,
    COUNTERS_BLOCK,
    END,
    IDENTITY,
    POLL,
    SETTINGS,
    SETTINGS_BLOCK,
    Register,
)
from rigctl.wire.registers import BlockLayout, words_of
from rigctl.world.modbus_slave import Answer

FIRST_KEPT = BY_NAME["signal_polarity"].address
"""Below it in the settings lies the computer's own traffic: heartbeat and command."""
TRAFFIC = frozenset(entry.name for entry in SETTINGS if entry.address < FIRST_KEPT)

_RING_RAW = BY_NAME["ring_raw"]
_RING_TIME = BY_NAME["ring_time_us"]
_BLOCKS = {
    "identity": BlockLayout(0, 16, IDENTITY),
    "poll": BlockLayout(POLL[0].address, 64 - POLL[0].address, POLL),
    "counters": BlockLayout(*COUNTERS_BLOCK, COUNTERS),
}
_SETTING_OF_WORD = {
    address: entry for entry in SETTINGS for address in range(entry.address, entry.end)
}

Values = dict[str, Sequence[int]]


class Owner(Protocol):
    """Who lives behind the registers."""

    def report(self, block: str) -> Values:
        """Raw integers by name of ``"identity"``, ``"poll"`` or ``"counters"``."""
        ...

    def ring(self) -> tuple[Sequence[int], Sequence[int]]:
        """Raw counts and board times of the load-cell ring, by place."""
        ...

    def command(self, command: int, sequence: int) -> bool:
        """Execute; all settings of the same write are in place. False refuses the write."""
        ...

    def beat(self) -> None:
        """The heartbeat register changed."""
        ...

    def written(self, names: set[str]) -> None:
        """These settings were written and hold."""
        ...


class RegisterBank:
    """All registers of one board. ``settings`` holds raw integers by name.

    ``version`` grows whenever a setting may have changed; traffic is none.
    """

    def __init__(self, owner: Owner) -> None:
        self._owner = owner
        self.settings: dict[str, int] = {}
        self.version = 0
        self._words: dict[int, int] = {}
        for entry in SETTINGS:
            self.put(entry.name, entry.default)

    def put(self, name: str, raw: int) -> None:
        """The board itself changes one of its settings."""
        entry = BY_NAME[name]
        self.version += 1
        self.settings[name] = raw
        self._words.update(enumerate(words_of(entry, raw), entry.address))

    def restore(self, values: dict[str, int]) -> None:
        """Bring settings back, but neither heartbeat nor command."""
        for name, raw in values.items():
            if BY_NAME[name].address >= FIRST_KEPT:
                self.put(name, raw)

    def exists(self, address: int, count: int) -> bool:
        """All these addresses can be read."""
        return address + count <= END

    def read(self, address: int, count: int) -> Sequence[int]:
        """Words of addresses that exist; between the entries they are 0."""
        words = [0] * count
        for name, layout in _BLOCKS.items():
            if _overlap(address, count, layout.address, layout.count):
                laid = layout.words(self._owner.report(name))
                _lay(words, address, laid, layout.address)
        if _overlap(address, count, *SETTINGS_BLOCK):
            for place in range(max(address, FIRST_SETTING), min(address + count, END_SETTING)):
                words[place - address] = self._words.get(place, 0)
        if address + count > _RING_RAW.address:
            self._lay_ring(words, address)
        return words

    def write(self, address: int, words: Sequence[int]) -> Answer:
        """Apply all words or none; a new command sequence is executed at the end."""
        places = range(address, address + len(words))
        if any(place not in _SETTING_OF_WORD for place in places):
            return Answer.NO_REGISTER
        touched = {_SETTING_OF_WORD[place].name: _SETTING_OF_WORD[place] for place in places}
        before = {place: self._words[place] for place in places}
        settings = {name: self.settings[name] for name in touched}
        self._words.update(zip(places, words, strict=True))
        answer = self._take_over(touched.values())
        if answer is Answer.OK and self._is_new("command_sequence", settings):
            answer = self._execute()
        if answer is not Answer.OK:
            self._words.update(before)
            self.settings.update(settings)
        else:
            self._tell(set(touched), self._is_new("heartbeat", settings))
        return answer

    def _is_new(self, name: str, before: dict[str, int]) -> bool:
        return name in before and self.settings[name] != before[name]

    def _tell(self, touched: set[str], beats: bool) -> None:
        if beats:
            self._owner.beat()
        if touched - TRAFFIC:
            self.version += 1
            self._owner.written(touched)

    def _take_over(self, entries: Iterable[Register]) -> Answer:
        for entry in entries:
            raw = _integer(entry, [self._words[a] for a in range(entry.address, entry.end)])
            if not entry.low <= raw <= entry.high:
                return Answer.BAD_VALUE
            self.settings[entry.name] = raw
        return Answer.OK

    def _execute(self) -> Answer:
        done = self._owner.command(self.settings["command"], self.settings["command_sequence"])
        return Answer.OK if done else Answer.REFUSED

    def _lay_ring(self, words: list[int], address: int) -> None:
        raw, times = self._owner.ring()
        for entry, numbers in ((_RING_RAW, raw), (_RING_TIME, times)):
            laid = [word for number in numbers for word in words_of(entry, number)]
            _lay(words, address, laid, entry.address)


FIRST_SETTING, END_SETTING = SETTINGS_BLOCK[0], sum(SETTINGS_BLOCK)


def _overlap(address: int, count: int, other: int, other_count: int) -> bool:
    return address < other + other_count and other < address + count


def _lay(words: list[int], address: int, source: Sequence[int], source_address: int) -> None:
    """Copy the part of ``source`` that lies inside ``words``."""
    first = max(address, source_address)
    end = min(address + len(words), source_address + len(source))
    if first < end:
        words[first - address : end - address] = source[
            first - source_address : end - source_address
        ]


def _integer(entry: Register, words: Sequence[int]) -> int:
    value = words[0] if entry.words == 1 else words[0] << 16 | words[1]
    top = 1 << (16 * entry.words - 1)
    return value - 2 * top if entry.kind.startswith("i") and value >= top else value
