"""The virtual drum's brain: walks the table of states, supervises, obeys commands.

It behaves as the firmware does, event by event: a conversion of the load cell, a timer, an
index mark, the end of a move, a command. Times are world microseconds; the board's own clock
runs ``clock`` times as fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rigctl.wire.drum_map import SETTINGS, Command, CommandResult, Signal
from rigctl.wire.drum_states import LIFT_FAULTS, OUTPUTS, Event, Fault, State, next_state
from rigctl.world.bench import Bench
from rigctl.world.drum_conditions import accepts
from rigctl.world.drum_health import Health
from rigctl.world.drum_loadcell import PERIOD_US, SILENCE_PERIODS, LoadcellWatch
from rigctl.world.drum_motion import DrumMotion
from rigctl.world.drum_presser import Presser
from rigctl.world.drum_registers import RegisterBank
from rigctl.world.drum_step_test import GainProposal, StepTest
from rigctl.world.drum_tables import (
    BLIND_LIFT_US,
    BOOT_US,
    EVENTS,
    GOALS,
    LIFT_US,
    SAVE_US,
    SELFTEST_LIMIT_US,
    SLOWEST_SEARCH_MM_S,
    UNSUPERVISED,
    Timer,
)
from rigctl.world.drum_tares import Tares
from rigctl.world.drum_turner import Turner
from rigctl.world.drum_waits import Waits


class Controller:
    """The drum board between wire and bench, from one boot to the next."""

    def __init__(
        self, bench: Bench, motion: DrumMotion, bank: RegisterBank, clock: float, at_us: int
    ) -> None:
        self._bank = bank
        self.clock = clock
        self._boot_us = self.now_us = at_us
        self.state = State.BOOT
        self.fault = Fault.NONE
        self.fault_at_us = 0
        self.acknowledged = 0
        self.result = CommandResult.NONE
        self.saved: dict[str, int] = {}
        self._saving: tuple[int, dict[str, int]] = (0, {})
        self.cell = LoadcellWatch()
        self.turner = Turner(bench, motion, clock, at_us)
        self.presser = Presser(bench, bank, self.cell, clock)
        self.actuator = self.presser.actuator
        self.proposal: GainProposal | None = None
        self.tares = Tares(bank, self.cell, self.turner)
        self._goal: State | None = None
        self.health = Health(bench.disturbances, bank, self.cell, at_us)
        self.rewired(at_us)
        self.waits = Waits()
        self.waits.start(Timer.BOOT, at_us + BOOT_US)

    # What happens to it

    @property
    def next_us(self) -> float:
        """When :meth:`pass_time` must be called next."""
        return min(self.waits.next_us, self.turner.motion.next_us)

    def board_us(self, at_us: int) -> int:
        """The board's own clock, not wrapped."""
        return int((at_us - self._boot_us) * self.clock)

    def board_times_us(self, at_us: NDArray[np.int64]) -> NDArray[np.int64]:
        """:meth:`board_us` of many instants."""
        times: NDArray[np.int64] = ((at_us - self._boot_us) * self.clock).astype(np.int64)
        return times

    def pass_time(self, now_us: int) -> None:
        """Do what is due by now."""
        self.now_us = now_us
        self.turner.motion.pass_time(now_us)
        for timer in self.waits.over(now_us):
            if self.waits.is_over(timer, now_us):
                self.waits.stop(timer)
                self._timer_handlers()[timer]()

    def conversion(self, now_us: int, raw: int) -> None:
        """The load cell's amplifier offers a reading."""
        self.now_us = now_us
        self.health.silent = False
        self._wait(Timer.SILENCE, SILENCE_PERIODS * PERIOD_US)
        self.cell.tare_counts = self._setting("tare_counts")
        self.cell.ug_per_count = self._setting("scale_ug_per_count")
        self.cell.place_counts = self.tares.place_counts(now_us)
        self.cell.take(raw, self.board_us(now_us))
        self.tares.reading(raw, now_us)
        self._check_loadcell()
        if self.state is State.SELFTEST:
            self._go(Event.SELFTEST_PASSED)
        self._finish_tare()
        self._press()

    def converted(self, last_us: int, touched: bool) -> None:
        """Sound conversions up to this time were taken and pressed with elsewhere."""
        self.now_us = last_us
        self._wait(Timer.SILENCE, SILENCE_PERIODS * PERIOD_US)
        self._pressed(touched)

    def index_mark(self, at_us: int) -> None:
        """An index mark began."""
        self.now_us = max(self.now_us, at_us)
        good = self.turner.mark(at_us, self._bank.settings, self._move_done)
        if not good and self.health.fitted(Signal.INDEX):
            self.raise_fault(Fault.STEP_COUNT)

    def limit_reached(self, now_us: int) -> None:
        """The actuator reached a limit that was asked for, or its end."""
        self.now_us = now_us
        drive = self.actuator.duty
        self.actuator.off()
        if drive < 0.0:
            self._lifted()
        elif self.actuator.at_lower_end and (
            self.health.fitted(Signal.END_SWITCHES) or self.health.fitted(Signal.POSITION)
        ):
            self.raise_fault(Fault.ACTUATOR_END)
        elif self.state is State.APPROACH and not self.presser.in_contact:
            self.raise_fault(Fault.NO_CONTACT)

    def estop_changed(self, now_us: int) -> None:
        """The emergency-stop contact opened or closed."""
        self.now_us = now_us
        if self.health.estop_open and self.state is not State.BOOT:
            self.raise_fault(Fault.ESTOP)

    def beat(self, now_us: int) -> None:
        """The computer shows that it is alive."""
        self.health.beat_us = now_us
        if Timer.HEARTBEAT in self.waits:
            self._wait(Timer.HEARTBEAT, 1000 * self._setting("heartbeat_limit_ms"))

    def command(self, now_us: int, command: Command, sequence: int) -> bool:
        """Begin a command; False where the state or a present cause refuses it."""
        self.now_us = now_us
        if not accepts(self, command, self._bank.settings):
            return False
        self.tares.abandon()
        self.acknowledged, self.result = sequence, CommandResult.RUNNING
        self._goal = GOALS.get(command)
        event = EVENTS.get(command)
        if command is Command.STOP:
            self._goal = State.ARMED if self._stops_something() else self.state
        if event is not None:
            self._go(event)
        self._commands()[command]()
        return True

    def raise_fault(self, fault: Fault) -> None:
        """Latch the fault unless one is latched, and go where the table says."""
        if self.fault is Fault.NONE:
            self.fault, self.fault_at_us = fault, self.board_us(self.now_us)
        self._go(Event.TIMED_FAULT if fault in LIFT_FAULTS else Event.OFF_FAULT)

    @property
    def causes(self) -> list[Fault]:
        """Faults whose cause is present now."""
        return self.health.causes(self.fault, self.now_us)

    # Inside

    def _setting(self, name: str) -> int:
        return self._bank.settings[name]

    def _wait(self, timer: Timer, board_us: float) -> None:
        self.waits.start(timer, self.now_us + math.ceil(board_us / self.clock))

    def _timer_handlers(self) -> dict[Timer, Callable[[], None]]:
        return {
            Timer.BOOT: self._booted,
            Timer.SELFTEST: lambda: self.raise_fault(Fault.SELFTEST),
            Timer.HEARTBEAT: lambda: self.raise_fault(Fault.HEARTBEAT),
            Timer.SILENCE: self._loadcell_silent,
            Timer.APPROACH: self._approach_overdue,
            Timer.LIFT: lambda: self._go(Event.LIFT_TIME_OVER),
            Timer.BLIND_LIFT: self._lifted,
            Timer.SAVE: self._saved,
        }

    def _booted(self) -> None:
        self._go(Event.BOOTED)
        if self.health.estop_open:
            self.raise_fault(Fault.ESTOP)

    def _loadcell_silent(self) -> None:
        self.health.silent = True
        self.raise_fault(Fault.LOADCELL_SILENT)

    def _approach_overdue(self) -> None:
        touched = self.presser.in_contact
        self.raise_fault(Fault.FORCE_UNREACHED if touched else Fault.NO_CONTACT)

    def _check_loadcell(self) -> None:
        if self.state in (State.BOOT, State.SELFTEST):
            return
        for fault in self.health.loadcell:
            self.raise_fault(fault)

    def _go(self, event: Event) -> None:
        target = next_state(self.state, event)
        if target is None:
            return
        left, self.state = self.state, target
        if target is not left:
            self._enter(left)
        if target is self._goal and self.result is CommandResult.RUNNING:
            self._finish(CommandResult.DONE)

    def _enter(self, left: State) -> None:
        state = self.state
        outputs = OUTPUTS[state]
        self.waits.stop(Timer.APPROACH)
        if outputs.actuator in ("off", "hold"):
            self.actuator.off()
        if not outputs.stepper_enabled:
            self.turner.halt(self.now_us)
        if outputs.actuator != "force_loop":
            self.presser.settled = False
        if state is not State.HOLD:
            self.presser.step_test = None
        self._supervise_heartbeat()
        entry = {
            State.SELFTEST: lambda: self._wait(Timer.SELFTEST, SELFTEST_LIMIT_US),
            State.IDLE: lambda: self.waits.stop(Timer.SELFTEST),
            State.APPROACH: self._begin_approach,
            State.RETRACT: self._begin_lift,
            State.FAULT_LIFT: self._begin_fault_lift,
            State.FAULT_OFF: self._fail,
        }.get(state)
        if entry is not None:
            entry()

    def _supervise_heartbeat(self) -> None:
        if self.state in UNSUPERVISED:
            self.waits.stop(Timer.HEARTBEAT)
        elif Timer.HEARTBEAT not in self.waits:
            self._wait(Timer.HEARTBEAT, 1000 * self._setting("heartbeat_limit_ms"))

    def _finish(self, result: CommandResult) -> None:
        if self.result is CommandResult.RUNNING:
            self.result = result
        self._goal = None

    def _fail(self) -> None:
        self.tares.abandon()
        self._finish(CommandResult.FAILED)

    # Commands

    def _stops_something(self) -> bool:
        return next_state(self.state, Event.STOP) is State.RETRACT

    def _commands(self) -> dict[Command, Callable[[], None]]:
        def nothing() -> None:
            pass

        return {
            Command.MOVE: self._begin_move,
            Command.HOME: self._begin_home,
            Command.TUNE: self._begin_test,
            Command.TARE_TURN: self._begin_tare_turn,
            Command.RUN: self._begin_run,
            Command.RETRACT: nothing,
            Command.CLEAR: self._forget_fault,
            Command.TARE: self.cell.begin_tare,
            Command.ZERO_STEPS: self._zero_steps,
            Command.SAVE: self._save,
            Command.DEFAULTS: self._defaults,
            Command.NONE: lambda: self._finish(CommandResult.DONE),
        } | dict.fromkeys((Command.ARM, Command.DISARM, Command.APPROACH, Command.STOP), nothing)

    def _begin_move(self) -> None:
        self.turner.move(self.now_us, self._bank.settings, self._move_done)

    def _begin_home(self) -> None:
        self.presser.force.forget_run_out()
        self.turner.home(self.now_us, self._bank.settings, self._move_done)

    def _begin_tare_turn(self) -> None:
        self.tares.begin_turn()
        self.turner.tare_turn(self.now_us, self._bank.settings, self._move_done)

    def _begin_run(self) -> None:
        self.turner.run(self.now_us, self._bank.settings, lambda: self._moved(Event.TRAVEL_DONE))

    def _move_done(self) -> None:
        self._moved(Event.MOVE_DONE)

    def _moved(self, event: Event) -> None:
        if self.turner.homing or not self.tares.finish_turn():
            self.turner.homing = False
            self._finish(CommandResult.FAILED)
        if self.health.fitted(Signal.INDEX) and self.turner.mark_missed(self.now_us):
            self.raise_fault(Fault.STEP_COUNT)
        else:
            self._go(event)

    def _forget_fault(self) -> None:
        self.fault, self.fault_at_us = Fault.NONE, 0

    def rewired(self, now_us: int) -> None:
        """The settings may say anew which optional wires there are."""
        inverted = bool(self._setting("signal_polarity") >> Signal.SYNC & 1)
        self.turner.wire_sync(self.health.fitted(Signal.SYNC), inverted, now_us)

    def _zero_steps(self) -> None:
        self.turner.zero(self.now_us)
        self.presser.force.forget_run_out()
        self._finish(CommandResult.DONE)

    def _save(self) -> None:
        self._saving = (self.acknowledged, dict(self._bank.settings))
        self._wait(Timer.SAVE, SAVE_US)

    def _saved(self) -> None:
        """The last byte is in the EEPROM; a reset before it leaves what was saved before."""
        sequence, self.saved = self._saving
        if sequence == self.acknowledged:
            self._finish(CommandResult.DONE)

    def _defaults(self) -> None:
        self._bank.restore({entry.name: entry.default for entry in SETTINGS})
        self.tares.tared = False
        self.rewired(self.now_us)
        self._finish(CommandResult.DONE)

    def _finish_tare(self) -> None:
        good = self.tares.finish_still()
        if good is not None:
            self._finish(CommandResult.DONE if good else CommandResult.FAILED)

    # The actuator

    def _begin_lift(self) -> None:
        self.turner.brake(self.now_us, self._bank.settings, self._lifted)
        if not (self.health.fitted(Signal.END_SWITCHES) or self.health.fitted(Signal.POSITION)):
            self._wait(Timer.BLIND_LIFT, BLIND_LIFT_US)
        self.presser.lift(1e-3 * self._setting("lift_clearance_um"))

    def _lifted(self) -> None:
        still = not self.turner.motion.moving and Timer.BLIND_LIFT not in self.waits
        if self.state is State.RETRACT and still and self.actuator.duty == 0.0:
            self._go(Event.LIFTED)

    def _begin_fault_lift(self) -> None:
        self._fail()
        self.turner.brake(self.now_us, self._bank.settings, lambda: None)
        self.presser.lift()
        self._wait(Timer.LIFT, LIFT_US)

    def _begin_approach(self) -> None:
        self.presser.begin(self.now_us)
        search_ms = self._setting("approach_limit_um") / SLOWEST_SEARCH_MM_S + 500
        self._wait(Timer.APPROACH, 1000 * search_ms)

    def _press(self) -> None:
        """One step of the force loop, with each reading of the load cell."""
        mode = OUTPUTS[self.state].actuator
        if mode not in ("approach", "force_loop"):
            return
        touched = self.presser.in_contact
        self.presser.step(self.now_us, self.turner, self.state is State.APPROACH)
        self._pressed(self.presser.in_contact and not touched)

    def _pressed(self, touched: bool) -> None:
        """A step of the force loop was done, perhaps the first in touch."""
        if touched:
            self._wait(Timer.APPROACH, 1000 * self._setting("approach_timeout_ms"))
        test = self.presser.step_test
        if test is not None and test.finished:
            self._end_test(test)
        if self.presser.settled and self.state is State.APPROACH:
            self.presser.keep_stiffness()
            self._go(Event.FORCE_SETTLED)

    def _begin_test(self) -> None:
        self.proposal = None
        self.presser.begin_test()

    def _end_test(self, test: StepTest) -> None:
        self.proposal, self.presser.step_test = test.proposal(), None
        self._finish(CommandResult.DONE if self.proposal else CommandResult.FAILED)
