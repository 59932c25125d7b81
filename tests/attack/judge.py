"""Check an attack by the bench's log: force, drum position, rod travel and duty.

Each broken rule is reported in a sentence that begins with the rule's name:

force      the force never exceeds the compiled limit by more than the overshoot
heartbeat  after 250 ms without a heartbeat nothing presses; the drive is off after a second if
           contact has ended by then, and after the longest lift in any case: also where the zero
           was taken of a drum that touched with less than 25 g, because a free one then reads as
           one in contact, and lifts to the top
stop       while the emergency stop is pressed nothing drives or turns, and the state allows neither
lift       a lift that ends without a command has ended contact, also with a broken potentiometer,
           and with a broken upper switch beside a potentiometer; not where the potentiometer or
           the load cell was set as reversed, because then the actuator seems to be, and
           everything goes off; nor where a board that is not commissioned has no potentiometer,
           because then a force that falls may be one that presses on a reversed cell
guard      settings that determine the meaning of a force change only at rest and without contact
bounds     the board accepts no value that the register table forbids
tare       the board accepts no plain tare during contact
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Any, Protocol

import numpy as np

from rigctl.bench.circuit import AS_DRAWN, Circuit, Wiper, Wire
from rigctl.boards.drum_codes import Command, Guard, Signal
from rigctl.boards.drum_registers import BY_NAME, SETTINGS, Register
from rigctl.boards.drum_states import State
from tests.attack.benches import Span

TOUCH_G = 25.0
"""Certain contact: the board regards 20 g as the reading of a free drum."""
RESTING = (State.IDLE, State.ARMED)
STOPPED_STATES = (State.BOOT, State.SELFTEST, State.FAULT_OFF)
LIFT_STATES = {State.FAULT_LIFT: State.FAULT_OFF, State.RETRACT: State.ARMED}
"""States that lift, and the states in which the lift ends."""
SILENCE_MS = 250
TICKS_MS = 3
"""The board counts the age of a heartbeat in ticks of its clock."""
COAST_MS = 250
"""Time until a rod without current rests: eight lags of the actuator, and its backlash."""
OFF_LIMIT_MS = 1000
CONTACT_LOST_MS = 160
"""Time until the board detects the end of contact: eight conversions, their delay and a tick."""
LIFT_LIMIT_MS = 8000
WEIGHED_MS = 500
"""Time in which an armed board weighs a drum that stands still: 16 conversions, twice over."""
STILL_MM = 0.005
STEP_END_MS = 6
"""Time until the drum reaches its last step."""
ESTOP_BIT, POSITION_BIT = 1 << Signal.ESTOP, 1 << Signal.POSITION
POSITION_AS_DRAWN: dict[str, Any] = {
    "wiper": Wiper.DRAWN,
    "ground_end": True,
    "supply_end": True,
    "pull_down": True,
}
BOUND_SETTINGS = ("signal_polarity", "optional_signals", "scale_ug_per_count", "loadcell_slow")
"""Settings that a commission is bound to, and with it the place of a contact."""
WIRES = tuple(BY_NAME[name].address for name in ("signal_polarity", "optional_signals"))
States = tuple[State, State]
"""States that the board reported before and after a request."""
TARES = (Command.TARE, Command.TARE_TURN)
MOST_FORCE_G = 2000.0
UNCOMMISSIONED_G = 300.0
SHOCK_G = 200.0
"""Before a reading of 150 g a touch may be a shock in the air; 3 mm/s · 18.5 ms later on the
stiffest contact."""
UNFELT_UM = 1000 + 6 * 18.5
"""Further travel where the cell stops feeling: 1 mm, and at 6 mm/s a sample and its delay
(decision 0040)."""


class Limit(Protocol):
    """Returns the highest force of a bench, g."""

    def __call__(self, most_g: float | None = None, further_um: float = 0.0) -> float: ...


class Judge:
    """Checks one attack. ``broken`` holds a sentence for each broken rule.

    ``limit(most_g, further_um)`` returns the force of the bench where the board lifts at ``most_g``
    and ``further_um`` of travel later. After a wire was wrong only the rules ``force``,
    ``heartbeat`` and ``stop`` hold, by the bench alone; ``lift`` too after one of the
    potentiometer or of the upper switch.

    What no firmware can answer is left out:

    * the force of a contact that began with a load cell that feels nothing, or no longer does
      before it has felt more than a shock in the air, where no place of an earlier contact bounds
      it, the cell reads as at its zero, and the board has to believe it.
      It reads so where it was broken when the zero was taken, and an ``is_balanced`` one always.
      The board has to believe it where it is commissioned, where the cell's wire came and went
      since the boot, which a finger does alike, and an ``is_balanced`` one that felt a finger;
    * a load cell, a potentiometer and an actuator that are wrong together;
    * an emergency stop of which neither contact works.
    """

    def __init__(
        self, limit: Limit, is_commissioned: bool = True, is_balanced: bool = False
    ) -> None:
        self._limit, self._is_commissioned = limit, is_commissioned
        self._is_balanced = is_balanced
        self._circuit, self._is_whole, self._least_gain = AS_DRAWN, True, 1.0
        self._zero_is_blind = self._seems_reversed = self._position_lied = False
        self._lifts_gently, self._zero_is_off = True, False
        self._armed_ms = self._coasts_until_ms = 0
        self._place_is_kept = self._place_is_known = False
        self._cell_changes, self._finger_was_felt, self._contact_is_blind = 0, False, False
        self._only_position_broke = self._only_upper_end_broke = self._has_position = True
        self._nothing_shows = False
        self.was_unbounded = False
        self._stands_unbounded = False
        self._highest_g = BY_NAME["over_force"].default * 0.1
        self.peak_g = self.force_g = 0.0
        self._set_limit()
        self.broken: dict[str, str] = {}
        self.now_ms = self._heartbeat_at_ms = self._last_contact_ms = self._lifting_ms = 0
        self._stop_since_ms: int | None = None
        self._button_ms = -1
        self._stop_wiring_is_default, self._booted, self._zero_is_known = True, True, False
        self._state = State.BOOT

    @property
    def checks_motion(self) -> bool:
        """Whether motion is checked, which needs short spans."""
        return self._stop_since_ms is not None or self.now_ms - self._heartbeat_at_ms > SILENCE_MS

    def heartbeat(self, at_ms: int) -> None:
        """Note a heartbeat."""
        self._heartbeat_at_ms = max(self._heartbeat_at_ms, at_ms)

    def set_stop(self, pressed: bool) -> None:
        """Note a change of the emergency stop; ignore one that was configured away before."""
        self._button_ms = self.now_ms
        if not pressed:
            self._stop_since_ms = None
        elif self._stop_since_ms is None and self._stop_wiring_is_default:
            self._stop_since_ms = self.now_ms

    def booted(self) -> None:
        """Note a boot, which clears the board's knowledge of contact and zero."""
        self._booted, self._zero_is_known, self._zero_is_off = True, False, False
        self._zero_is_blind = self._place_is_known = self._finger_was_felt = False
        self._cell_changes = 0
        self._coasts_until_ms = self.now_ms + COAST_MS
        self._state = State.BOOT

    def pushed(self, force_g: float) -> None:
        """Note a finger on the load cell."""
        self._finger_was_felt |= bool(force_g and self._circuit.cell_gain)

    def rewired(self, circuit: Circuit) -> None:
        """Note how the bench is connected from now on."""
        before, self._circuit, self._is_whole = self._circuit, circuit, False
        self._cell_changes += bool(before.cell_gain) != bool(circuit.cell_gain)
        if self.force_g < SHOCK_G:
            self._contact_is_blind = not circuit.cell_gain
        self._position_lied |= _position_lies(circuit)
        self._only_position_broke &= replace(circuit, **POSITION_AS_DRAWN) == AS_DRAWN
        self._only_upper_end_broke &= replace(circuit, upper_end=Wire.DRAWN) == AS_DRAWN
        is_swapped = circuit.actuator_polarity < 0
        if (
            is_swapped
            and not circuit.cell_gain
            and (_position_lies(circuit) or _is_broken(circuit))
        ):
            self._nothing_shows = True
        if circuit.cell_gain:
            self._least_gain = min(self._least_gain, abs(circuit.cell_gain))
        if self._stop_since_ms is not None:
            self._stop_since_ms = self.now_ms
        self._set_limit()

    def _set_limit(self) -> None:
        if not self._is_commissioned:
            self.limit_g = UNCOMMISSIONED_G
        elif self._is_whole:
            self.limit_g = self._limit()
        else:
            most_g = min(MOST_FORCE_G, self._highest_g) / self._least_gain
            self.limit_g = self._limit(most_g, UNFELT_UM)

    def check_span(self, span: Span, state: State) -> None:
        """Check a span of the log and the state that the board reports at its end."""
        self.now_ms = span.end_ms
        if not (self._zero_is_known or self._circuit.cell_gain):
            self._zero_is_blind = True
        if span.end_ms > span.start_ms:
            self._check_force(span)
            self._check_silence(span)
            self._check_stop(span, state)
        self._check_lift(span, state)
        if state is not State.ARMED or self._state is not State.ARMED:
            self._armed_ms = span.end_ms
        elif span.end_ms - self._armed_ms > WEIGHED_MS:
            self._zero_is_off = False
        if state is State.ARMED and self._state is State.RETRACT:
            if self._booted and self._circuit.cell_gain:
                self._zero_is_blind = False
            self._booted, self._zero_is_known = False, True
        if state is State.HOLD and self._state is State.APPROACH:
            self._place_is_known = self._has_position
            self._place_is_kept = self._place_is_known and self._is_commissioned
        self._state = state

    def _check_force(self, span: Span) -> None:
        highest = float(span.force_g.max())
        # What an unbounded contact has left stands through a reset. Once the rod has come to rest
        # it may only fall.
        still = span.start_ms >= self._coasts_until_ms
        most_g = self.force_g + 1.0 if still else inf
        standing_g = most_g if self._stands_unbounded else 0.0
        self.force_g, self.peak_g = float(span.force_g[-1]), max(self.peak_g, highest)
        if highest <= 0:
            self._contact_is_blind = not self._circuit.cell_gain
        pressed = np.flatnonzero(span.force_g > 0)
        if pressed.size:
            self._last_contact_ms = span.start_ms + int(pressed[-1])
        within = highest <= max(self.limit_g, standing_g) or self._is_unbounded
        left = self._is_unbounded or self._stands_unbounded
        self._stands_unbounded = left and self.force_g > self.limit_g
        self.was_unbounded |= self._is_unbounded
        self._rule("force", within, f"{highest:.0f} g of {self.limit_g:.0f} g")

    @property
    def _is_unbounded(self) -> bool:
        """Whether nothing that the board knows can bound the force."""
        reads_zero = self._zero_is_blind or self._is_balanced
        unseen = self._contact_is_blind and reads_zero and self._is_believed
        return self._nothing_shows or (unseen and not self._has_place)

    @property
    def _is_believed(self) -> bool:
        """Whether the board has to believe that the load cell feels."""
        return self._is_commissioned or self._seems_touched

    @property
    def _seems_touched(self) -> bool:
        """Whether the cell seems to have felt a finger at its zero."""
        came_and_went = self._cell_changes >= 2
        return came_and_went or (self._is_balanced and self._finger_was_felt)

    @property
    def _has_place(self) -> bool:
        """Whether the place of a contact bounds the next one; a finger lifts that of a boot ago."""
        kept = self._place_is_kept and not self._seems_touched
        return (self._place_is_known or kept) and not self._position_lied

    def _check_silence(self, span: Span) -> None:
        silent_ms = span.start_ms - self._heartbeat_at_ms - TICKS_MS
        if silent_ms < SILENCE_MS:
            return
        self._rule("heartbeat", span.drive[1] <= 0, f"presses after {silent_ms} ms of silence")
        if silent_ms >= SILENCE_MS + COAST_MS and self._is_whole:
            travelled_mm = span.rod_mm[1] - span.rod_mm[0]
            self._rule(
                "heartbeat", travelled_mm < STILL_MM, f"{travelled_mm:.2f} mm down, {silent_ms} ms"
            )
        if span.start_ms >= self._off_by_ms():
            self._rule("heartbeat", _off(span), f"not off after {silent_ms} ms of silence")

    def _off_by_ms(self) -> int:
        """Return the latest time at which the drive must be off."""
        if self._zero_is_off or not (self._zero_is_known and self._is_whole):
            return self._heartbeat_at_ms + SILENCE_MS + LIFT_LIMIT_MS + 2 * TICKS_MS
        return max(self._heartbeat_at_ms + OFF_LIMIT_MS, self._last_contact_ms + CONTACT_LOST_MS)

    def _check_stop(self, span: Span, state: State) -> None:
        if self._stop_since_ms is None or span.start_ms <= self._stop_since_ms:
            return
        held_ms = span.start_ms - self._stop_since_ms
        reaches_board = self._circuit.estop in (Wire.DRAWN, Wire.OPEN)
        if not (reaches_board or self._circuit.stop_cuts_supply):
            return
        if reaches_board:
            self._rule("stop", span.drive == (0, 0), f"drives {span.drive} after {held_ms} ms")
            self._rule("stop", state in STOPPED_STATES, f"{state.name} while it is held")
        if held_ms >= STEP_END_MS:
            self._rule("stop", not _steps(span), f"turns after {held_ms} ms")
        if held_ms >= COAST_MS:
            travelled_mm = span.rod_mm[1] - span.rod_mm[0]
            self._rule("stop", abs(travelled_mm) < STILL_MM, f"the rod moves after {held_ms} ms")

    def _check_lift(self, span: Span, state: State) -> None:
        """Check that a lift ends without contact, or after the longest permitted time."""
        if state in LIFT_STATES and state is not self._state:
            self._lifting_ms = span.start_ms
        if self._stop_since_ms is not None or LIFT_STATES.get(self._state) is not state:
            return
        if self._seems_reversed or not (self._is_whole or self._lifts_by_others(state)):
            return
        if self._lifts_gently and not self._has_position:
            return
        # An emergency stop that was configured before ends a lift all the same.
        if self._button_ms >= self._lifting_ms:
            return
        lasted_ms = span.end_ms - self._lifting_ms
        is_over = self.force_g < TOUCH_G or lasted_ms >= LIFT_LIMIT_MS
        text = f"{state.name} after {lasted_ms} ms at {self.force_g:.0f} g"
        self._rule("lift", is_over, text)

    def _lifts_by_others(self, state: State) -> bool:
        """Return whether the wires that are whole end a lift that is no fault's."""
        broke = self._only_position_broke and not self._position_lied
        return state is State.ARMED and (
            broke or (self._only_upper_end_broke and self._has_position)
        )

    def check_write(self, register: Register, before: int, after: int, states: States) -> None:
        """Check a value that the board accepted."""
        self._rule("bounds", register.accepts(after), f"{register.name} is {after}")
        if register.name == "heartbeat" and before != after:
            self.heartbeat(self.now_ms)
        if register.name == "over_force":
            self._highest_g = max(self._highest_g, after * 0.1)
            self._set_limit()
        if register.name == "scale_ug_per_count" and after < 0:
            self._seems_reversed = True
        if register.name in BOUND_SETTINGS and before != after:
            self._place_is_kept = self._place_is_known = False
            self._lifts_gently = True
        if register.address in WIRES:
            self._check_wires(register, after, before != after)
        if register.guard is not Guard.NONE and before != after and self._is_whole:
            allowed = self._may_change(register.guard, states)
            text = f"{register.name} became {after} in {states[0].name} at {self.force_g:.0f} g"
            self._rule("guard", allowed, text)

    def _check_wires(self, register: Register, after: int, changed: bool) -> None:
        if register.name == "signal_polarity" and after & POSITION_BIT:
            self._seems_reversed = True
        if register.name == "optional_signals" and not after & POSITION_BIT:
            self._has_position = False
        normal = after & ESTOP_BIT == (register.name == "optional_signals")
        self._stop_wiring_is_default = self._stop_wiring_is_default and normal
        self._zero_is_known = self._zero_is_known and not changed

    def _may_change(self, guard: Guard, states: States) -> bool:
        resting = states[0] in RESTING or states[1] in RESTING
        unknown = guard is Guard.RESTING and self._booted
        return resting and self._stop_since_ms is None and (self.force_g < TOUCH_G or unknown)

    def check_command(self, command: int, states: States) -> None:
        """Check a command that the board accepted."""
        if command in (Command.ARM, Command.NUDGE):  # each is a sign of life
            self.heartbeat(self.now_ms)
        if command == Command.COMMISSION:
            self._is_commissioned = True
            self._lifts_gently = False
            self._place_is_kept |= self._place_is_known
            self._set_limit()
        if command == Command.TARE_ANYWAY:
            self._zero_is_blind |= not self._circuit.cell_gain
            self._place_is_kept = self._place_is_known = False
        self._zero_is_off |= command in TARES and self.force_g > 0
        if not self._is_whole:
            return
        if command in TARES:
            self._rule("tare", self.force_g < TOUCH_G, f"taken at {self.force_g:.0f} g")
        if command == Command.DEFAULTS:
            self._rule("guard", self._may_change(Guard.RESTING, states), "DEFAULTS were taken")

    def _rule(self, name: str, holds: bool, what: str) -> None:
        if not holds:
            self.broken.setdefault(name, f"{name}: {what}")


def _position_lies(circuit: Circuit) -> bool:
    """Return whether the potentiometer shows a plausible place that is not the rod's."""
    return circuit.is_position_reversed or (circuit.wiper is Wiper.OPEN and not circuit.pull_down)


def _is_broken(circuit: Circuit) -> bool:
    """Return whether the potentiometer's reading is none."""
    return circuit.wiper is not Wiper.DRAWN or not (circuit.ground_end and circuit.supply_end)


def _steps(span: Span) -> bool:
    return bool(np.ptp(span.place_mm) > 0)


def _off(span: Span) -> bool:
    return span.drive == (0, 0) and not _steps(span)


def covered(address: int, count: int) -> list[Register]:
    """Return the settings with at least one word in a block."""
    return [r for r in SETTINGS if r.address < address + count and address < r.end]


def value_of(register: Register, words: list[int]) -> int:
    """Return a register's value from its words."""
    raw = words[0] if register.words == 1 else words[0] << 16 | words[1]
    bits = 16 * register.words
    return raw - (1 << bits) if register.kind[0] == "i" and raw >> (bits - 1) else raw
