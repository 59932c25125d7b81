"""Run attacks: bring a board to a state, run the attack's steps and its continuation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

from rigctl.bench.wirings import circuit_of
from rigctl.boards.drum_codes import Command
from rigctl.boards.drum_registers import BY_NAME, SETTINGS_BLOCK, Register
from rigctl.boards.drum_states import State
from tests.attack.benches import AttackBench, Log, is_balanced, limit_g, slow_actuator
from tests.attack.judge import Judge, States, covered, value_of
from tests.attack.steps import (
    Action,
    ActionKind,
    Attack,
    Rewire,
    Step,
    Write,
    full_sequence,
    send,
    wait,
    wait_until_idle,
    wire_sequence,
    write,
)

PASSING = (State.SELFTEST, State.POSITION, State.APPROACH, State.RUN, State.RETRACT, State.NUDGE)
MAX_STEP_MS, MOTION_STEP_MS = 900, 20
"""Longest time between two reads of the log, and the same while motion is checked."""
COMMAND, SEQUENCE = BY_NAME["command"].address, BY_NAME["command_sequence"].address
START = SETTINGS_BLOCK[0]
FAR_STEPS = 10_000

ARM: tuple[Step, ...] = (
    wait_until_idle(500),
    send(Command.COMMISSION),
    wait(40),
    send(Command.ARM),
    wait_until_idle(3000),
    send(Command.TARE),
    wait(800),
)
HOLD: tuple[Step, ...] = (*ARM, send(Command.APPROACH), wait_until_idle(6000))
SESSION: tuple[Step, ...] = (*HOLD, send(Command.RETRACT), wait_until_idle(3000))
"""The board has pressed once, before something in its rig breaks while it is switched off."""
PREPARATIONS: dict[State, tuple[Step, ...]] = {
    State.BOOT: (Action(ActionKind.RESET),),
    State.SELFTEST: (Action(ActionKind.RESET), wait(20)),
    State.IDLE: (wait_until_idle(500),),
    State.ARMED: ARM,
    State.POSITION: (*ARM, write("move_target", FAR_STEPS), send(Command.MOVE), wait(90)),
    State.APPROACH: (*ARM, send(Command.APPROACH), wait(3250)),
    State.HOLD: HOLD,
    State.RUN: (*HOLD, send(Command.RUN), wait(300)),
    State.RETRACT: (*HOLD, send(Command.RETRACT), wait(20)),
    State.FAULT_LIFT: (
        *HOLD,
        Action(ActionKind.HEARTBEAT, 0),
        wait(251),
        Action(ActionKind.HEARTBEAT, 1),
    ),
    State.NUDGE: (
        wait_until_idle(500),
        write("nudge_direction", 1),
        send(Command.NUDGE),
        wait(60),
    ),
    State.FAULT_OFF: (*HOLD, Action(ActionKind.ESTOP, 1), wait(10)),
}
"""Steps from power-up to each state. APPROACH is just before or in first contact; FAULT_LIFT still
presses; in FAULT_OFF the emergency stop is pressed and the drum rests on the skin."""


class Outcome(NamedTuple):
    """Result of an attack; ``began`` is the state in which its steps ran.

    ``was_unbounded``: nothing that the board knew could bound the force.
    """

    attack: Attack
    began: State
    peak_g: float
    limit_g: float
    broken: dict[str, str]
    was_unbounded: bool

    def __str__(self) -> str:
        return f"{'; '.join(self.broken.values()) or f'{self.peak_g:.0f} g'} <- {self.attack}"


class Attacker:
    """Runs one attack on a bench at power-up."""

    def __init__(self, bench: AttackBench, is_commissioned: bool = True) -> None:
        self._bench, self._log = bench, Log(bench)
        alike = is_balanced(bench.parameters)
        self.judge = Judge(partial(limit_g, bench), is_commissioned, alike)
        self._sequence = 1000
        self._wirings: dict[str, None] = {}

    def run(self, attack: Attack) -> Outcome:
        """Run an attack from power-up to its end."""
        before, after = PREPARATIONS[attack.state], full_sequence(attack)
        if not attack.commissioned:
            after = attack.steps
        if attack.wired:
            before, after = wire_sequence(attack, before)
            if attack.from_power_up and attack.commissioned:
                before = (*SESSION, *before)
        self.run_steps(before)
        began = self._bench.state
        self.run_steps(after)
        judge = self.judge
        return Outcome(
            attack, began, judge.peak_g, judge.limit_g, judge.broken, judge.was_unbounded
        )

    def run_steps(self, steps: Iterable[Step]) -> None:
        """Run steps in order."""
        for step in steps:
            if isinstance(step, Write):
                self._write(step)
            elif isinstance(step, Rewire):
                self._rewire(step)
            else:
                self._act(step.kind, step.value)

    def _act(self, kind: ActionKind, value: int) -> None:
        if kind is ActionKind.SEND_COMMAND:
            self._sequence += 1
            self._write(Write(COMMAND, (value, self._sequence)))
        elif kind is ActionKind.WAIT:
            self._advance(value, lambda: False)
        elif kind is ActionKind.WAIT_UNTIL_IDLE:
            self._advance(value, lambda: self._bench.state not in PASSING)
        elif kind is ActionKind.SLOW_ACTUATOR:
            slow_actuator(self._bench.plant)
        elif kind is ActionKind.PUSH:
            self._bench.push(value)
            self.judge.pushed(value)
        elif kind is ActionKind.HEARTBEAT:
            self._check_log()
            self._bench.set_heartbeat(bool(value))
        else:
            self._press_button(kind, value)

    def _rewire(self, step: Rewire) -> None:
        """Change a wire; the log before and after is checked separately."""
        self._check_log()
        self._wirings.pop(step.name, None)
        if step.on:
            self._wirings[step.name] = None
        circuit = circuit_of(self._wirings)
        self._bench.connect(circuit)
        self.judge.rewired(circuit)

    def _press_button(self, kind: ActionKind, value: int) -> None:
        """Press a button; the log before and after is checked separately."""
        self._check_log()
        if kind is ActionKind.RESET:
            self._bench.reset()
            self.judge.booted()
        else:
            self._bench.estop(bool(value))
            self.judge.set_stop(bool(value))
            self._advance(2, lambda: False, step_ms=1)

    def _advance(self, for_ms: int, done: Callable[[], bool], step_ms: int = MAX_STEP_MS) -> None:
        plant = self._bench.plant
        end_ms = plant.time_ms + for_ms
        while plant.time_ms < end_ms and not done():
            longest = MOTION_STEP_MS if self.judge.checks_motion else step_ms
            self._bench.run(min(longest, step_ms, end_ms - plant.time_ms))
            self._check_log()

    def _check_log(self) -> None:
        state, span = self._bench.state, self._log.span()
        self.judge.heartbeat(self._bench.last_heartbeat_ms)
        self.judge.check_span(span, state)

    def _write(self, request: Write) -> None:
        before, state = self._settings(), self._bench.state
        self._check_log()
        accepted = self._bench.write(*request) == 0
        self.judge.now_ms = self._bench.plant.time_ms
        if accepted and before:
            self._check_accepted(request, before, (state, self._bench.state))
        self._check_log()

    def _check_accepted(self, request: Write, before: list[int], states: States) -> None:
        address, words = request
        given = address <= SEQUENCE < address + len(words)
        if given and before[SEQUENCE - START] != words[SEQUENCE - address]:
            command = words[COMMAND - address] if address <= COMMAND else before[COMMAND - START]
            self.judge.check_command(command, states)
        after = self._settings()
        for register in covered(address, len(words)):
            self.judge.check_write(register, _of(before, register), _of(after, register), states)

    def _settings(self) -> list[int]:
        return self._bench.read(*SETTINGS_BLOCK)


def _of(settings: list[int], register: Register) -> int:
    place = register.address - START
    return value_of(register, settings[place : place + register.words])


def run_attack(bench: AttackBench, attack: Attack) -> Outcome:
    """Attack a bench at power-up, and free it."""
    try:
        return Attacker(bench, attack.commissioned).run(attack)
    finally:
        bench.close()
