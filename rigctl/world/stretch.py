"""World time from one event to the next, compiled: all that happens are load-cell conversions."""

from __future__ import annotations

import math

import numpy as np

from rigctl.wire.drum_map import ForceMode, Signal
from rigctl.wire.drum_states import OUTPUTS, State
from rigctl.wire.drum_tare import place_table
from rigctl.world import press_kernel as kernel
from rigctl.world.bench import Bench
from rigctl.world.drum_controller import Controller
from rigctl.world.drum_registers import RegisterBank
from rigctl.world.glances import Shot
from rigctl.world.simulation import LoadcellFault

LONGEST_US = 2_000_000
MOST_SHOTS = 24
MOST_CONVERSIONS = 200
"""More than there are in the longest stretch, whatever the amplifier's clock."""

LOOP = slice(kernel.SINE, kernel.STATE_SIZE)
ALL_SIGNALS = sum(1 << signal for signal in Signal)
_PRESSING = ("approach", "force_loop")


class Stretch:
    """Runs the bench under one boot of the drum board. The same to the bit as without it.

    ``raws`` and ``board_us``, int64 (n,), are the conversions of the last :meth:`run`, in counts
    and the board's time. From world time ``shot_us`` on it shoots every
    :data:`press_kernel.SHOT_EVERY_US`; ``shots`` are those of the last :meth:`run`.
    """

    def __init__(self, bench: Bench, controller: Controller, bank: RegisterBank) -> None:
        self._bench = bench
        self._brain = controller
        self._bank = bank
        self._state = np.zeros(kernel.STATE_SIZE)
        self._given = np.zeros(kernel.GIVEN_SIZE)
        self._raws = np.zeros(MOST_CONVERSIONS, np.int64)
        self._times_us = np.zeros(MOST_CONVERSIONS, np.int64)
        self._shots = np.zeros((MOST_SHOTS, len(Shot._fields)))
        self.shot_us = math.inf
        self.shots: list[Shot] = []
        self.raws = self.board_us = np.zeros(0, np.int64)
        self._usual_seen = (-1, False)
        self._given_seen: tuple[object, ...] = ()
        self._given[: kernel.CLOCK] = self._bench_numbers()

    @property
    def possible(self) -> bool:
        """Nothing is up that only the board's own code knows how to handle."""
        brain, cell = self._brain, self._brain.cell
        return (
            brain.state not in (State.BOOT, State.SELFTEST)
            and not brain.tares.busy
            and cell.sequence > 0
            and not brain.health.silent
            and self._bench.disturbances.loadcell is LoadcellFault.NONE
            and (not self._presses or self._bank.settings["force_mode"] == ForceMode.HOLD)
            and brain.presser.step_test is None
            and self._usual
        )

    @property
    def _usual(self) -> bool:
        """Every wire is there and as it should be, and no angle has a tare of its own."""
        version, usual = self._usual_seen
        if version != self._bank.version:
            settings = self._bank.settings
            wired = settings["optional_signals"] == ALL_SIGNALS and not settings["signal_polarity"]
            usual = wired and not place_table(settings)
            self._usual_seen = (self._bank.version, usual)
        return usual

    def run(self, until_us: int) -> int:
        """Up to a world time at most :data:`LONGEST_US` away, or to an event before it.

        Returns the bits of :data:`press_kernel.STOPPED` and so on; what the conversions mean
        for the board has been seen to.
        """
        cell, plant = self._bench.loadcell, self._bench.plant
        self._load()
        expected = 2 + int(max(0, until_us - cell.next_us) / cell.period_us)
        noise = cell.noise.rows(cell.number, expected).reshape(-1)
        news = int(
            kernel.run(
                plant.state,
                plant.constants,
                plant.log,
                plant.footprint,
                self._state,
                self._given,
                noise,
                self._raws,
                self._times_us,
                self._shots,
                until_us,
            )
        )
        taken = int(self._state[kernel.TAKEN])
        if self._state[kernel.SHOTS] or self.shots:
            self._collect(self._brain.cell.sequence)
        self.raws = self._raws[:taken].copy()
        self.board_us = self._brain.board_times_us(self._times_us[:taken])
        if taken:
            self._store(taken, bool(news & kernel.TOUCHED))
        return news

    @property
    def _presses(self) -> bool:
        return OUTPUTS[self._brain.state].actuator in _PRESSING

    def _load(self) -> None:
        cell, seen, presser = self._bench.loadcell, self._brain.cell, self._brain.presser
        actuator = presser.actuator
        self._state[:] = (
            cell.next_us,
            cell.since_origin,
            cell.crept_g,
            seen.equal_run,
            seen.newest,
            seen.force_g,
            presser.contact_mm or 0.0,
            presser.settled,
            presser.outside_us,
            actuator.duty,
            actuator.owed_mm,
            *actuator.limits_mm,
            0,
            self.shot_us,
            0,
            *presser.force.numbers,
        )
        turner = self._brain.turner
        seen_now = (self._bank.version, self._brain.state, turner.zero_mm, turner.motion.motion)
        if seen_now != self._given_seen:
            self._given[kernel.CLOCK :] = self._board_numbers()
            self._given_seen = seen_now

    def _bench_numbers(self) -> tuple[float, ...]:
        p, cell, actuator = self._bench.parameters, self._bench.loadcell, self._brain.actuator
        return (
            cell.origin_us,
            cell.period_us,
            cell.average_ms,
            cell.creep_gain,
            p.loadcell_creep,
            p.loadcell_drift_g,
            p.loadcell_drift_s,
            p.loadcell_noise_g,
            p.loadcell_offset_counts,
            p.loadcell_ug_per_count,
            self._bench.plant.counts_per_mm,
            actuator.mm_per_count,
            actuator.travel_mm,
            self._brain.turner.turn_steps,
            self._brain.turner.step_mm,
        )

    def _board_numbers(self) -> tuple[float, ...]:
        settings, brain = self._bank.settings, self._brain
        presses = 2.0 if brain.state is State.APPROACH else float(self._presses)
        target_g = 0.1 * settings["force_set"]
        return (
            brain.clock,
            settings["tare_counts"],
            settings["scale_ug_per_count"],
            0.1 * settings["over_force"],
            presses,
            target_g,
            0.01 * settings["gain_p"],
            0.01 * settings["gain_i"],
            1e-3 * settings["settle_band"] * target_g,
            settings["settle_time_ms"],
            1e-3 * settings["dead_band_permille"],
            brain.turner.zero_mm,
            *brain.turner.motion.motion,
        )

    def _collect(self, sequence: int) -> None:
        self.shot_us = float(self._state[kernel.SHOT_US])
        self.shots = [
            Shot(
                int(at_us), sequence + int(taken), rod_mm, force_g, duty, bool(settled), bool(high)
            )
            for at_us, taken, rod_mm, force_g, duty, settled, high in self._shots[
                : int(self._state[kernel.SHOTS])
            ].tolist()
        ]

    def _store(self, taken: int, touched: bool) -> None:
        numbers = self._state.tolist()
        brain = self._brain
        seen, settings = brain.cell, self._bank.settings
        raws, board_us = self.raws.tolist(), self.board_us.tolist()
        self._bench.loadcell.converted(
            taken, int(numbers[kernel.NEXT_US]), numbers[kernel.CREPT], raws[-1]
        )
        seen.tare_counts, seen.ug_per_count = (
            settings["tare_counts"],
            settings["scale_ug_per_count"],
        )
        seen.place_counts = 0.0
        seen.taken(raws, board_us, int(numbers[kernel.EQUAL_RUN]))
        seen.weigh()
        if self._given[kernel.PRESSES]:
            self._restore_press(numbers, touched)
        brain.converted(int(self._times_us[taken - 1]), touched)

    def _restore_press(self, numbers: list[float], touched: bool) -> None:
        presser = self._brain.presser
        if touched:
            presser.contact_mm = numbers[kernel.CONTACT_MM]
        presser.settled = bool(numbers[kernel.SETTLED])
        presser.outside_us = int(numbers[kernel.OUTSIDE_US])
        presser.force.restore(numbers[LOOP])
        actuator = presser.actuator
        actuator.duty, actuator.owed_mm = numbers[kernel.DUTY], numbers[kernel.OWED]
        actuator.limits_mm = numbers[kernel.LOW_MM], numbers[kernel.HIGH_MM]
