"""Attacks on a drum board: what a computer may write, and what happens around it.

An attack begins in a state of the board, does its steps there, and goes on as an attacker would
(:func:`whole`). Attacks are drawn from a seed and a number, so that one can be had again alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np

from rigctl.wire.drum.codes import Command, Guard
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, SETTINGS
from rigctl.wire.drum.states import State

VALUES = (0, 1, 0x7FFF, 0x8000, 0xFFFF)
STATES = tuple(State)
FIRST, LAST = SETTINGS[0].address, SETTINGS[-1].address
MOST_WORDS = 8
PLACES = tuple(r for r in SETTINGS if r.name.startswith("tare_place"))
GUARDED = tuple(r for r in SETTINGS if r.guard is not Guard.NONE and r not in PLACES[1:])
"""What decides what a force means: drawn more often than the rest."""
NO_COMMAND = 17
"""A value of register ``command`` that means nothing."""

FEW = 32
"""Values of a register that are all drawn as often: modes, and bits of wires."""

NO_LOAD, UNDER_LOAD = 30_000, 1_000_000
"""Raw counts between which the bench's load cell reads, from nothing to 2,000 g."""


class What(Enum):
    """What is done besides writing registers; the value of the act in brackets."""

    GIVE = "command"  # a Command, with a new sequence
    ESTOP = "emergency stop"  # 1 pressed, 0 released
    BEATS = "heartbeat"  # 1 goes on, 0 falls silent
    RESET = "reset"  # 0
    WAIT = "wait ms"
    REST = "rest ms"  # until no state passes by itself, at most so long
    WEAKEN = "weak actuator"  # 0: from now on it is slow


class Write(NamedTuple):
    """Registers written in one request."""

    address: int
    words: tuple[int, ...]

    def __str__(self) -> str:
        names = [r.name for r in SETTINGS if r.address <= self.address < r.end]
        return f"{names[0]}({self.address}) := {' '.join(f'{word:04x}' for word in self.words)}"


class Act(NamedTuple):
    """Anything else."""

    what: What
    value: int = 0

    def __str__(self) -> str:
        known = self.what is What.GIVE and self.value < NO_COMMAND
        return f"{self.what.value} {Command(self.value).name if known else self.value}"


Step = Write | Act


class Attack(NamedTuple):
    """Steps that are done in a state of the board."""

    name: str
    state: State
    steps: tuple[Step, ...]

    def __str__(self) -> str:
        return f"{self.name}, {self.state.name}: {'; '.join(map(str, self.steps))}"


def _words(register: Register, raw: int) -> tuple[int, ...]:
    if register.words == 1:
        return (raw & 0xFFFF,)
    return (raw >> 16 & 0xFFFF, raw & 0xFFFF)


def write(name: str, raw: int) -> Write:
    """Write one setting in raw integers."""
    return Write(BY_NAME[name].address, _words(BY_NAME[name], raw))


def give(command: Command) -> Act:
    """Give a command."""
    return Act(What.GIVE, command)


_REST: tuple[Step, ...] = (
    Act(What.WAIT, 100),
    give(Command.CLEAR),
    give(Command.ARM),
    Act(What.WAIT, 60),
    Act(What.ESTOP, 0),
    Act(What.WAIT, 5),
    give(Command.CLEAR),
    give(Command.TARE),
    Act(What.WAIT, 700),
)
_LIFT: tuple[Step, ...] = (give(Command.ARM), Act(What.REST, 1800))
_PRESS: tuple[Step, ...] = (
    write("over_force", 30_000),
    write("force_set", 15_000),
    give(Command.APPROACH),
    Act(What.REST, 4500),
    give(Command.TARE),
    Act(What.WAIT, 800),
    give(Command.APPROACH),
    Act(What.REST, 4500),
    give(Command.RUN),
    Act(What.WAIT, 400),
)
_FALL_SILENT: tuple[Step, ...] = (
    Act(What.BEATS, 0),
    Act(What.WAIT, 1300),
    give(Command.CLEAR),
    give(Command.ARM),
    Act(What.WAIT, 350),
    Act(What.BEATS, 1),
)
_STOP: tuple[Step, ...] = (
    give(Command.CLEAR),
    give(Command.ARM),
    Act(What.WAIT, 100),
    Act(What.ESTOP, 1),
    Act(What.WAIT, 20),
    give(Command.CLEAR),
    give(Command.ARM),
    Act(What.WAIT, 100),
)


def whole(attack: Attack) -> tuple[Step, ...]:
    """Return the attack's steps and what every attacker goes on with.

    The drum is brought to rest, lifted, and presses as hard as it can; what was written is written
    again on the way, since it may have been refused before. Then the computer falls silent, and at
    last the emergency stop is held.
    """
    again = tuple(step for step in attack.steps if isinstance(step, Write))
    return (*attack.steps, *_REST, *again, *_LIFT, *again, *_PRESS, *_FALL_SILENT, *_STOP)


def grid() -> Iterator[Attack]:
    """Every writable register and word × :data:`VALUES` × every state."""
    for state in STATES:
        for write_ in _single_writes():
            yield Attack("grid", state, (write_,))


def _single_writes() -> Iterator[Write]:
    for address in range(FIRST, LAST + 1):
        for value in VALUES:
            yield Write(address, (value,))
    for register in SETTINGS:
        if register.words == 2:
            for value in VALUES:
                yield Write(register.address, (0, value))
                yield Write(register.address, (value, value))


def drawn(seed: int, number: int) -> Attack:
    """Attack ``number`` of a seed: two writes at least, and what else comes to mind."""
    random = np.random.default_rng([seed, number])
    state = STATES[number % len(STATES)]
    others = [_any_step(random) for _ in range(int(random.integers(0, 5)))]
    steps: list[Step] = [_any_write(random), _any_write(random), *others]
    order = random.permutation(len(steps))
    return Attack(f"seed {seed} number {number}", state, tuple(steps[i] for i in order))


def _any_step(random: np.random.Generator) -> Step:
    kind = random.random()
    if kind < 0.25:
        return _any_write(random)
    if kind < 0.45:
        return Act(What.GIVE, int(random.integers(0, NO_COMMAND + 1)))
    if kind < 0.65:
        return Act(What.WAIT, int(np.exp(random.uniform(0, 6.5))))
    if kind < 0.75:
        return Act(What.ESTOP, int(random.integers(0, 2)))
    if kind < 0.85:
        return Act(What.BEATS, int(random.integers(0, 2)))
    return Act(What.RESET) if kind < 0.95 else Act(What.WEAKEN)


def _any_write(random: np.random.Generator) -> Write:
    """One setting mostly; now and then a block from anywhere, words from anywhere."""
    if random.random() < 0.1:
        count = int(random.integers(2, MOST_WORDS + 1))
        start = int(random.integers(FIRST, LAST + 2 - count))
        return Write(start, tuple(int(random.choice(VALUES)) for _ in range(count)))
    choice = GUARDED if random.random() < 0.5 else SETTINGS
    register = choice[int(random.integers(len(choice)))]
    return Write(register.address, _words(register, _any_value(register, random)))


def _any_value(register: Register, random: np.random.Generator) -> int:
    """Out of the blue, at a bound, inside, or small, where most scales and depths lie."""
    kind = random.random()
    if register.high < FEW and kind < 0.7:
        return int(random.integers(register.low, register.high + 1))
    if kind < 0.2:
        return int(random.choice(VALUES))
    if kind < 0.4:
        edges = (register.low, register.high, register.low - 1, register.high + 1, register.least)
        return int(random.choice(edges))
    if kind < 0.6 and register.name == "tare_counts":
        return int(random.integers(NO_LOAD, UNDER_LOAD))
    if kind < 0.8:
        return int(random.integers(register.low, register.high + 1))
    least = max(register.least, 1)
    sign = -1 if register.low < 0 and random.random() < 0.3 else 1
    return sign * int(np.exp(random.uniform(np.log(least), np.log(register.high + 1.0))))
