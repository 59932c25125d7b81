"""Judges an attack by what the bench logged: force, place of the drum, travel and duty.

What breaks a rule is kept as a sentence that begins with the rule's name:

force      never above the compiled limit by more than the overshoot
heartbeat  after 250 ms of silence nothing presses; off after a second where contact is gone by
           then, and at the end of the longest lift in any case
stop       while the emergency stop is held nothing drives or turns, and no state is left for it
lift       a lift that ends by itself has ended contact
guard      what decides what a force means changes at rest only, where the bench feels no contact
bounds     no value is taken that the register table forbids
tare       no plain tare is taken while the bench feels contact
"""

from __future__ import annotations

import numpy as np

from rigctl.wire.drum.codes import Command, Guard
from rigctl.wire.drum.register_entry import Register
from rigctl.wire.drum.register_table import BY_NAME, SETTINGS
from rigctl.wire.drum.states import State
from tests.attack.benches import Span

TOUCH_G = 25.0
"""Force that is contact beyond doubt: the board takes 20 g for a free drum's reading."""
RESTING = (State.IDLE, State.ARMED)
HELD_STATES = (State.BOOT, State.SELFTEST, State.FAULT_OFF)
LIFTS = {State.FAULT_LIFT: State.FAULT_OFF, State.RETRACT: State.ARMED}
"""States that lift, and what they end in."""
SILENCE_MS = 250
TICKS_MS = 3
"""A beat's age is counted in ticks of a clock of the board's own."""
COAST_MS = 250
"""After it a rod without current rests: eight lags of the actuator, and its play."""
OFF_MS = 1000
SEEN_GONE_MS = 160
"""Eight conversions, their delay, and a tick: until the board knows that contact is gone."""
LIFT_LIMIT_MS = 8000
STILL_MM = 0.005
GLIDE_MS = 6
"""The drum glides on to where its last step wants it."""
ESTOP_BIT = 1
WIRES = tuple(BY_NAME[name].address for name in ("signal_polarity", "optional_signals"))
States = tuple[State, State]
"""What the board said before a request and after it."""
TARES = (Command.TARE, Command.TARE_TURN)


class Judge:
    """Follows one attack. ``broken`` holds a sentence for each rule that did not stand."""

    def __init__(self, limit_g: float) -> None:
        self.limit_g, self.peak_g, self.force_g = limit_g, 0.0, 0.0
        self.broken: dict[str, str] = {}
        self.now_ms = self._beat_ms = self._touched_ms = self._lifting_ms = 0
        self._held_ms: int | None = None
        self._stop_as_drawn, self._booted, self._knows_zero = True, True, False
        self._state = State.BOOT

    @property
    def tense(self) -> bool:
        """Motion is judged: look often."""
        return self._held_ms is not None or self.now_ms - self._beat_ms > SILENCE_MS

    def beat(self, at_ms: int) -> None:
        """The computer showed that it is alive."""
        self._beat_ms = max(self._beat_ms, at_ms)

    def stop(self, pressed: bool) -> None:
        """The emergency stop changes now. One that was told away before it was pressed is none."""
        if not pressed:
            self._held_ms = None
        elif self._held_ms is None and self._stop_as_drawn:
            self._held_ms = self.now_ms

    def booted(self) -> None:
        """The board forgot what it knew of contact and zero."""
        self._booted, self._knows_zero = True, False
        self._state = State.BOOT

    def saw(self, span: Span, state: State) -> None:
        """Judge a span of the log, and the state that the board says at its end."""
        self.now_ms = span.end_ms
        if span.end_ms > span.start_ms:
            self._judge_force(span)
            self._judge_silence(span)
            self._judge_stop(span, state)
        self._judge_lift(span, state)
        if state is State.ARMED and self._state is State.RETRACT:
            self._booted, self._knows_zero = False, True
        self._state = state

    def _judge_force(self, span: Span) -> None:
        highest = float(span.force_g.max())
        self.force_g, self.peak_g = float(span.force_g[-1]), max(self.peak_g, highest)
        pressed = np.flatnonzero(span.force_g > 0)
        if pressed.size:
            self._touched_ms = span.start_ms + int(pressed[-1])
        self._rule("force", highest <= self.limit_g, f"{highest:.0f} g of {self.limit_g:.0f} g")

    def _judge_silence(self, span: Span) -> None:
        silent_ms = span.start_ms - self._beat_ms - TICKS_MS
        if silent_ms < SILENCE_MS:
            return
        self._rule("heartbeat", span.drive[1] <= 0, f"presses after {silent_ms} ms of silence")
        if silent_ms >= SILENCE_MS + COAST_MS:
            way_mm = span.rod_mm[1] - span.rod_mm[0]
            self._rule("heartbeat", way_mm < STILL_MM, f"{way_mm:.2f} mm down, {silent_ms} ms")
        if span.start_ms >= self._off_by_ms():
            self._rule("heartbeat", _off(span), f"not off after {silent_ms} ms of silence")

    def _off_by_ms(self) -> int:
        """After a second where contact is gone by then, and at the end of any lift."""
        if not self._knows_zero:
            return self._beat_ms + SILENCE_MS + LIFT_LIMIT_MS + 2 * TICKS_MS
        return max(self._beat_ms + OFF_MS, self._touched_ms + SEEN_GONE_MS)

    def _judge_stop(self, span: Span, state: State) -> None:
        if self._held_ms is None or span.start_ms <= self._held_ms:
            return
        held_ms = span.start_ms - self._held_ms
        self._rule("stop", span.drive == (0, 0), f"drives {span.drive} after {held_ms} ms")
        self._rule("stop", state in HELD_STATES, f"{state.name} while it is held")
        if held_ms >= GLIDE_MS:
            self._rule("stop", not _steps(span), f"turns after {held_ms} ms")
        if held_ms >= COAST_MS:
            way_mm = span.rod_mm[1] - span.rod_mm[0]
            self._rule("stop", abs(way_mm) < STILL_MM, f"the rod moves after {held_ms} ms")

    def _judge_lift(self, span: Span, state: State) -> None:
        """A lift that ends by itself has ended contact, or has gone on as long as any may."""
        if state in LIFTS and state is not self._state:
            self._lifting_ms = span.start_ms
        if self._held_ms is not None or LIFTS.get(self._state) is not state:
            return
        took_ms = span.end_ms - self._lifting_ms
        gone = self.force_g < TOUCH_G or took_ms >= LIFT_LIMIT_MS
        told = f"{state.name} after {took_ms} ms at {self.force_g:.0f} g"
        self._rule("lift", gone, told)

    def took(self, register: Register, before: int, after: int, states: States) -> None:
        """The board took a value."""
        self._rule("bounds", register.accepts(after), f"{register.name} is {after}")
        if register.name == "heartbeat" and before != after:
            self.beat(self.now_ms)
        if register.address in WIRES:
            self._told_wires(register, after, before != after)
        if register.guard is not Guard.NONE and before != after:
            allowed = self._may_change(register.guard, states)
            told = f"{register.name} became {after} in {states[0].name} at {self.force_g:.0f} g"
            self._rule("guard", allowed, told)

    def _told_wires(self, register: Register, after: int, changed: bool) -> None:
        normal = after & ESTOP_BIT == (register.name == "optional_signals")
        self._stop_as_drawn = self._stop_as_drawn and normal
        self._knows_zero = self._knows_zero and not changed

    def _may_change(self, guard: Guard, states: States) -> bool:
        resting = states[0] in RESTING or states[1] in RESTING
        unknown = guard is Guard.RESTING and self._booted
        return resting and self._held_ms is None and (self.force_g < TOUCH_G or unknown)

    def obeyed(self, command: int, states: States) -> None:
        """The board took a command."""
        if command == Command.ARM:
            self.beat(self.now_ms)
        if command in TARES:
            self._rule("tare", self.force_g < TOUCH_G, f"taken at {self.force_g:.0f} g")
        if command == Command.DEFAULTS:
            self._rule("guard", self._may_change(Guard.RESTING, states), "DEFAULTS were taken")

    def _rule(self, name: str, stands: bool, what: str) -> None:
        if not stands:
            self.broken.setdefault(name, f"{name}: {what}")


def _steps(span: Span) -> bool:
    return bool(np.ptp(span.place_mm) > 0)


def _off(span: Span) -> bool:
    return span.drive == (0, 0) and not _steps(span)


def covered(address: int, count: int) -> list[Register]:
    """Settings of which at least one word lies in so many from an address."""
    return [r for r in SETTINGS if r.address < address + count and address < r.end]


def value_of(register: Register, words: list[int]) -> int:
    """A register's value of its own words."""
    raw = words[0] if register.words == 1 else words[0] << 16 | words[1]
    bits = 16 * register.words
    return raw - (1 << bits) if register.kind[0] == "i" and raw >> (bits - 1) else raw
