"""Whoever attacks: brings a board to a state, does an attack's steps, and goes on pressing."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from rigctl.wire.drum.codes import Command
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, SETTINGS_BLOCK
from rigctl.wire.drum.states import State
from tests.attack.benches import AttackBench, Log, limit_g, weaken
from tests.attack.judge import Judge, States, covered, value_of
from tests.attack.steps import Act, Attack, Step, What, Write, give, whole, write

PASSING = (State.SELFTEST, State.POSITION, State.APPROACH, State.RUN, State.RETRACT)
LONG_MS, SHORT_MS = 900, 20
"""Between two looks at the log, and where motion is judged."""
COMMAND, SEQUENCE = BY_NAME["command"].address, BY_NAME["command_sequence"].address
START = SETTINGS_BLOCK[0]
FAR_STEPS = 10_000

ARM: tuple[Step, ...] = (
    Act(What.REST, 500),
    give(Command.ARM),
    Act(What.REST, 3000),
    give(Command.TARE),
    Act(What.WAIT, 800),
)
HOLD: tuple[Step, ...] = (*ARM, give(Command.APPROACH), Act(What.REST, 6000))
WAYS: dict[State, tuple[Step, ...]] = {
    State.BOOT: (Act(What.RESET),),
    State.SELFTEST: (Act(What.RESET), Act(What.WAIT, 20)),
    State.IDLE: (Act(What.REST, 500),),
    State.ARMED: ARM,
    State.POSITION: (*ARM, write("move_target", FAR_STEPS), give(Command.MOVE), Act(What.WAIT, 90)),
    State.APPROACH: (*ARM, give(Command.APPROACH), Act(What.WAIT, 3250)),
    State.HOLD: HOLD,
    State.RUN: (*HOLD, give(Command.RUN), Act(What.WAIT, 300)),
    State.RETRACT: (*HOLD, give(Command.RETRACT), Act(What.WAIT, 20)),
    State.FAULT_LIFT: (*HOLD, Act(What.BEATS, 0), Act(What.WAIT, 251), Act(What.BEATS, 1)),
    State.FAULT_OFF: (*HOLD, Act(What.ESTOP, 1), Act(What.WAIT, 10)),
}
"""From power-up to each state. APPROACH is just before or in first contact; FAULT_LIFT still
presses; in FAULT_OFF the emergency stop is held and the drum rests on the skin."""


class Outcome(NamedTuple):
    """What became of an attack; ``began`` is the state in which its steps were done."""

    attack: Attack
    began: State
    peak_g: float
    limit_g: float
    broken: dict[str, str]

    def __str__(self) -> str:
        return f"{'; '.join(self.broken.values()) or f'{self.peak_g:.0f} g'} <- {self.attack}"


class Attacker:
    """One attack on one bench that has just been switched on."""

    def __init__(self, bench: AttackBench) -> None:
        self._bench, self._log = bench, Log(bench)
        self.judge = Judge(limit_g(bench))
        self._sequence = 1000

    def carry_out(self, attack: Attack) -> Outcome:
        """Do it, from power-up to the end."""
        self.carry_on(WAYS[attack.state])
        began = self._bench.state
        self.carry_on(whole(attack))
        judge = self.judge
        return Outcome(attack, began, judge.peak_g, judge.limit_g, judge.broken)

    def carry_on(self, steps: Iterable[Step]) -> None:
        """Do steps, one behind the other."""
        for step in steps:
            if isinstance(step, Write):
                self._write(step)
            else:
                self._act(step.what, step.value)

    def _act(self, what: What, value: int) -> None:
        if what is What.GIVE:
            self._sequence += 1
            self._write(Write(COMMAND, (value, self._sequence)))
        elif what is What.WAIT:
            self._pass(value, lambda: False)
        elif what is What.REST:
            self._pass(value, lambda: self._bench.state not in PASSING)
        elif what is What.WEAKEN:
            weaken(self._bench.plant)
        elif what is What.BEATS:
            self._look()
            self._bench.beats(bool(value))
        else:
            self._touch(what, value)

    def _touch(self, what: What, value: int) -> None:
        """Buttons: time before and after is judged apart."""
        self._look()
        if what is What.RESET:
            self._bench.reset()
            self.judge.booted()
        else:
            self._bench.estop(bool(value))
            self.judge.stop(bool(value))
            self._pass(2, lambda: False, step_ms=1)

    def _pass(self, for_ms: int, done: Callable[[], bool], step_ms: int = LONG_MS) -> None:
        plant = self._bench.plant
        end_ms = plant.time_ms + for_ms
        while plant.time_ms < end_ms and not done():
            longest = SHORT_MS if self.judge.tense else step_ms
            self._bench.run(min(longest, step_ms, end_ms - plant.time_ms))
            self._look()

    def _look(self) -> None:
        state, span = self._bench.state, self._log.span()
        self.judge.beat(self._bench.beat_ms)
        self.judge.saw(span, state)

    def _write(self, request: Write) -> None:
        before, state = self._settings(), self._bench.state
        self._look()
        taken = self._bench.write(*request) == 0
        self.judge.now_ms = self._bench.plant.time_ms
        if taken and before:
            self._judge_taken(request, before, (state, self._bench.state))
        self._look()

    def _judge_taken(self, request: Write, before: list[int], states: States) -> None:
        address, words = request
        given = address <= SEQUENCE < address + len(words)
        if given and before[SEQUENCE - START] != words[SEQUENCE - address]:
            command = words[COMMAND - address] if address <= COMMAND else before[COMMAND - START]
            self.judge.obeyed(command, states)
        after = self._settings()
        for register in covered(address, len(words)):
            self.judge.took(register, _of(before, register), _of(after, register), states)

    def _settings(self) -> list[int]:
        return self._bench.read(*SETTINGS_BLOCK)


def _of(settings: list[int], register: Register) -> int:
    place = register.address - START
    return value_of(register, settings[place : place + register.words])


def attacked(bench: AttackBench, attack: Attack) -> Outcome:
    """Attack a bench that has just been switched on, and free it."""
    try:
        return Attacker(bench).carry_out(attack)
    finally:
        bench.close()
