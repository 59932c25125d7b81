"""Attacks on a drum board: writes of a computer, and events around them.

An attack begins in a state of the board, runs its steps there and then a fixed continuation
(:func:`full_sequence`). A seed and a number determine a random attack, so that it can be repeated
alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from enum import Enum
from typing import NamedTuple

import numpy as np

from rigctl.bench.wirings import WIRINGS
from rigctl.boards.drum_codes import Command, Guard
from rigctl.boards.drum_registers import BY_NAME, SETTINGS, Register
from rigctl.boards.drum_states import State

VALUES = (0, 1, 0x7FFF, 0x8000, 0xFFFF)
STATES = tuple(State)
FIRST, LAST = SETTINGS[0].address, SETTINGS[-1].address
MAX_WORDS = 8
PLACES = tuple(r for r in SETTINGS if r.name.startswith("tare_place"))
GUARDED = tuple(r for r in SETTINGS if r.guard is not Guard.NONE and r not in PLACES[1:])
"""Settings that determine the meaning of a force: drawn more often than the others."""
NO_COMMAND = max(Command) + 1
"""A value of register ``command`` that is no command."""

FEW_VALUES = 32
"""Registers with fewer values, such as modes and wire bits, draw each value equally often."""

NO_LOAD, UNDER_LOAD = 30_000, 1_000_000
"""Range of the bench's raw load-cell counts, from 0 to 2,000 g."""


class ActionKind(Enum):
    """Kind of an action other than a write; comments give the meaning of its value."""

    SEND_COMMAND = "command"  # a Command, with a new sequence
    ESTOP = "emergency stop"  # 1 pressed, 0 released
    HEARTBEAT = "heartbeat"  # 1 on, 0 off
    RESET = "reset"  # 0
    WAIT = "wait ms"
    WAIT_UNTIL_IDLE = "rest ms"  # wait for a stable state, at most this long
    SLOW_ACTUATOR = "weak actuator"  # 0
    PUSH = "finger g"  # on the load cell


class Write(NamedTuple):
    """Registers written in one request."""

    address: int
    words: tuple[int, ...]

    def __str__(self) -> str:
        names = [r.name for r in SETTINGS if r.address <= self.address < r.end]
        return f"{names[0]}({self.address}) := {' '.join(f'{word:04x}' for word in self.words)}"


class Action(NamedTuple):
    """An action other than a write."""

    kind: ActionKind
    value: int = 0

    def __str__(self) -> str:
        known = self.kind is ActionKind.SEND_COMMAND and self.value < NO_COMMAND
        return f"{self.kind.value} {Command(self.value).name if known else self.value}"


class Rewire(NamedTuple):
    """A wrong wiring of the catalogue, switched on or off."""

    name: str
    on: bool

    def __str__(self) -> str:
        return f"{self.name} {'on' if self.on else 'off'}"


Step = Write | Action | Rewire


class Attack(NamedTuple):
    """Steps that run in a state of the board.

    ``wired``: the wiring of an attack on wires; ``from_power_up``: it is wrong before the board is
    brought to that state; where the board is ``commissioned`` it has pressed before it was switched
    off. ``is_balanced``: its load cell under the lifted drum reads as a broken one.
    """

    name: str
    state: State
    steps: tuple[Step, ...]
    wired: str = ""
    from_power_up: bool = False
    commissioned: bool = True
    is_balanced: bool = False

    def __str__(self) -> str:
        board = "" if self.commissioned else ", not commissioned"
        first = f" with {self.wired}" if self.from_power_up else ""
        return f"{self.name}, {self.state.name}{board}{first}: {'; '.join(map(str, self.steps))}"


def _words(register: Register, raw: int) -> tuple[int, ...]:
    if register.words == 1:
        return (raw & 0xFFFF,)
    return (raw >> 16 & 0xFFFF, raw & 0xFFFF)


def write(name: str, raw: int) -> Write:
    """Write one setting in raw integers."""
    return Write(BY_NAME[name].address, _words(BY_NAME[name], raw))


def send(command: Command) -> Action:
    """Send a command."""
    return Action(ActionKind.SEND_COMMAND, command)


def wait(milliseconds: int) -> Action:
    """Wait."""
    return Action(ActionKind.WAIT, milliseconds)


def wait_until_idle(limit_ms: int) -> Action:
    """Wait until the board's state is stable."""
    return Action(ActionKind.WAIT_UNTIL_IDLE, limit_ms)


_REST: tuple[Step, ...] = (
    wait(100),
    send(Command.CLEAR),
    send(Command.ARM),
    wait(60),
    Action(ActionKind.ESTOP, 0),
    wait(5),
    send(Command.CLEAR),
    send(Command.TARE),
    wait(700),
)
_LIFT: tuple[Step, ...] = (send(Command.ARM), wait_until_idle(1800))
_PRESS: tuple[Step, ...] = (
    write("over_force", 30_000),
    write("force_set", 15_000),
    send(Command.COMMISSION),
    wait(40),
    send(Command.APPROACH),
    wait_until_idle(4500),
    send(Command.TARE),
    wait(800),
    send(Command.APPROACH),
    wait_until_idle(4500),
    send(Command.RUN),
    wait(400),
)
_STOP_HEARTBEAT: tuple[Step, ...] = (
    Action(ActionKind.HEARTBEAT, 0),
    wait(1300),
    send(Command.CLEAR),
    send(Command.ARM),
    wait(350),
    Action(ActionKind.HEARTBEAT, 1),
)
_STOP: tuple[Step, ...] = (
    send(Command.CLEAR),
    send(Command.ARM),
    wait(100),
    Action(ActionKind.ESTOP, 1),
    wait(20),
    send(Command.CLEAR),
    send(Command.ARM),
    wait(100),
)


def full_sequence(attack: Attack) -> tuple[Step, ...]:
    """Return the attack's steps and the continuation of every attack.

    The continuation brings the drum to rest, lifts it and presses as hard as possible; it repeats
    the attack's writes on the way, since the board may have rejected them before. Then the
    heartbeat stops, and finally the emergency stop is pressed.
    """
    again = tuple(step for step in attack.steps if isinstance(step, Write))
    return (*attack.steps, *_REST, *again, *_LIFT, *again, *_PRESS, *_STOP_HEARTBEAT, *_STOP)


BEYOND_FIRMWARE = ("bridge enable stuck high",)
"""Wirings that no firmware can answer; the current limit or a mechanical stop bounds these."""
WIRES = tuple(
    name
    for name, wiring in WIRINGS.items()
    if wiring.board == "drum" and wiring.reaches != "chips" and name not in BEYOND_FIRMWARE
)
"""Wirings of the drum's board, those that show on its chip alone left out."""

FINGER: tuple[Step, ...] = (
    wait(150),
    Action(ActionKind.PUSH, 300),
    wait(200),
    Action(ActionKind.PUSH, 0),
    wait(250),
)
"""A person presses on the load cell for a moment."""
_POWER_UP: tuple[Step, ...] = (Action(ActionKind.RESET), wait(250))
_LIFT_OFF: tuple[Step, ...] = (send(Command.RETRACT), wait_until_idle(1500))
_TRY_AGAIN: tuple[Step, ...] = (
    Action(ActionKind.HEARTBEAT, 1),
    Action(ActionKind.ESTOP, 0),
    wait(300),
    send(Command.CLEAR),
    send(Command.ARM),
    wait_until_idle(2500),
    send(Command.TARE),
    wait(700),
    send(Command.APPROACH),
    wait_until_idle(4000),
    send(Command.RUN),
    wait(250),
)
_LAST_STOP: tuple[Step, ...] = (Action(ActionKind.ESTOP, 1), wait(500), *_STOP[-3:])


def wire_sequence(
    attack: Attack, preparation: tuple[Step, ...]
) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
    """Return the steps of an attack on wires until the board is in its state, and the others.

    Its continuation tries to press as before, changes the wires once more, tries again, and ends
    with an emergency stop. On a board that is not commissioned every approach is the set-up's.
    """
    first = (Rewire(attack.wired, True), *_POWER_UP) if attack.from_power_up else ()
    again = tuple(step for step in attack.steps if not isinstance(step, Write))
    force = () if attack.commissioned else (write("force_set", 1000),)
    before = (*first, *force, *preparation)
    after = (*attack.steps, *_LIFT_OFF, *_TRY_AGAIN, *again, *_TRY_AGAIN, *_LAST_STOP)
    if attack.commissioned:
        return before, after
    return tuple(_for_setup(before)), tuple(_for_setup(after))


def _for_setup(steps: Iterable[Step]) -> Iterator[Step]:
    for step in steps:
        if step == send(Command.ARM):
            yield from FINGER
        if step == send(Command.APPROACH):
            yield send(Command.APPROACH_SETUP)
        elif step != send(Command.COMMISSION):
            yield step


WHEN = POWER_UP, LIFTED, PRESSED = "power-up", "ARMED", "HOLD"
_ARMING: tuple[Step, ...] = (
    wait(300),
    send(Command.CLEAR),
    *(write("nudge_direction", 1), *(send(Command.NUDGE), wait_until_idle(1500)) * 3),
    *(write("nudge_direction", 0), *(send(Command.NUDGE), wait_until_idle(1500)) * 3),
    *(send(Command.CLEAR), send(Command.ARM), wait_until_idle(9000)) * 2,
    send(Command.TARE),
    wait(700),
)
_PRESSING: tuple[Step, ...] = (send(Command.APPROACH), wait_until_idle(12_000), wait(300))


def pair_attack(first: str, second: str, when: str) -> Attack:
    """Return an attack with two wrong wirings on a board that is not commissioned.

    They are wrong from ``when`` on: one of :data:`WHEN`.
    """
    force = write("force_set", 1000)
    before, after = {
        POWER_UP: ((), (*_POWER_UP, force, *_ARMING, *_PRESSING)),
        LIFTED: ((force, *_ARMING), _PRESSING),
        PRESSED: ((force, *_ARMING, *_PRESSING), ()),
    }[when]
    wrong = (Rewire(first, True), Rewire(second, True))
    again = (*_LIFT_OFF, *_ARMING, *_PRESSING, *_LIFT_OFF)
    steps = tuple(_for_setup((*before, *wrong, *after, *again)))
    return Attack(f"{first} and {second} from {when}", State.IDLE, steps, commissioned=False)


def wire_attack(seed: int, number: int) -> Attack:
    """Return attack ``number`` of a seed on wires: each wiring in each state in turn.

    It is switched on at a random time, and often off again; another wiring may come besides, and
    random writes, commands, resets, silences and emergency stops.
    """
    random = np.random.default_rng([seed, number, len(WIRES)])
    turn, at = divmod(number, len(STATES))
    wired = WIRES[(turn + at) % len(WIRES)]
    from_power_up, commissioned = random.random() < 0.2, random.random() < 0.7
    steps: list[Step] = [_pause(random), Rewire(wired, not from_power_up)]
    for _ in range(int(random.integers(1, 6))):
        steps += [_random_change(random, wired), _pause(random)]
    name = f"wires, seed {seed} number {number}"
    is_balanced = bool(number % 2)
    return Attack(name, STATES[at], tuple(steps), wired, from_power_up, commissioned, is_balanced)


def restart_attacks() -> Iterator[Attack]:
    """Yield an attack for each wiring: it comes in contact, and the board restarts there.

    The wait is for the EEPROM, which keeps the place of the contact.
    """
    for wired in WIRES:
        steps = (wait(100), Rewire(wired, True), *_POWER_UP)
        yield Attack(f"restart with {wired}", State.HOLD, steps, wired)


def _random_change(random: np.random.Generator, wired: str) -> Step:
    kind = random.random()
    if kind < 0.4:
        return Rewire(wired, random.random() < 0.4)
    if kind < 0.5:
        return Rewire(WIRES[int(random.integers(len(WIRES)))], True)
    return _random_step(random)


def _pause(random: np.random.Generator) -> Step:
    return wait(int(np.exp(random.uniform(0, 7.0))))


def grid_attacks() -> Iterator[Attack]:
    """Yield an attack for every writable register and word × :data:`VALUES` × every state."""
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


def random_attack(seed: int, number: int) -> Attack:
    """Return attack ``number`` of a seed: at least two writes, and up to four other steps."""
    random = np.random.default_rng([seed, number])
    state = STATES[number % len(STATES)]
    others = [_random_step(random) for _ in range(int(random.integers(0, 5)))]
    steps: list[Step] = [_random_write(random), _random_write(random), *others]
    order = random.permutation(len(steps))
    return Attack(f"seed {seed} number {number}", state, tuple(steps[i] for i in order))


def _random_step(random: np.random.Generator) -> Step:
    kind = random.random()
    if kind < 0.25:
        return _random_write(random)
    if kind < 0.45:
        return Action(ActionKind.SEND_COMMAND, int(random.integers(0, NO_COMMAND + 1)))
    if kind < 0.65:
        return Action(ActionKind.WAIT, int(np.exp(random.uniform(0, 6.5))))
    if kind < 0.75:
        return Action(ActionKind.ESTOP, int(random.integers(0, 2)))
    if kind < 0.85:
        return Action(ActionKind.HEARTBEAT, int(random.integers(0, 2)))
    return Action(ActionKind.RESET) if kind < 0.95 else Action(ActionKind.SLOW_ACTUATOR)


def _random_write(random: np.random.Generator) -> Write:
    """Return a write of one setting, or in a tenth of the cases of a random block."""
    if random.random() < 0.1:
        count = int(random.integers(2, MAX_WORDS + 1))
        start = int(random.integers(FIRST, LAST + 2 - count))
        return Write(start, tuple(int(random.choice(VALUES)) for _ in range(count)))
    choice = GUARDED if random.random() < 0.5 else SETTINGS
    register = choice[int(random.integers(len(choice)))]
    return Write(register.address, _words(register, _random_value(register, random)))


def _random_value(register: Register, random: np.random.Generator) -> int:
    """Return a value: arbitrary, at a bound, inside, or small like most scales and depths."""
    kind = random.random()
    if register.high < FEW_VALUES and kind < 0.7:
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
