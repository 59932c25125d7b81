"""One bench with the drum's virtual board on it: time, the board's clock, edges, conversions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.bench import LOG_EVERY_MS, Bench
from rigctl.simulation.boards import kernel
from rigctl.simulation.boards.drum_firmware import SYNC, DrumFirmware
from rigctl.wire.drum.codes import ResetCause, Signal

NOMINAL_HZ = 16_000_000
MOST_CONVERSIONS = LOG_EVERY_MS
MOST_POLLS = 64
_Integers = NDArray[np.int64]


class DrumStepper:
    """Runs a bench and the board that hangs on it, in whole milliseconds.

    ``on_mark(level, at_us)`` hears of the index mark's edges; those of sync reach the bench.
    Raises RigFault where the board's library cannot be used.
    """

    def __init__(self, bench: Bench, library: Path | None = None) -> None:
        p = bench.parameters
        self.bench = bench
        self.board = DrumFirmware(library)
        self.on_mark = _nobody
        self._cycles_per_ms = NOMINAL_HZ / 1000 * (1.0 + p.drum_clock_ppm * 1e-6)
        start_steps = round(p.start_mm / p.mm_per_step)
        self._clock = np.array(
            [self._cycles_per_ms, start_steps, p.mm_per_step, p.actuator_travel_mm]
        )
        self._wires = np.zeros(4, np.bool_)
        self._calls = kernel.new_calls(self.board.handle, self.board.addresses)
        self._conversions = np.zeros((MOST_CONVERSIONS, 2), np.int64)
        self._poll_words = np.zeros((MOST_POLLS, self.board.poll_words.size), np.uint16)
        self._polled_ms = np.zeros(MOST_POLLS, np.int64)
        self.disturb()
        self.board.place(start_steps)
        self.board.boot(1 << ResetCause.POWER_ON)
        self._pass_edges()

    @property
    def time_ms(self) -> int:
        """World time up to which bench and board have run."""
        return self.bench.plant.time_ms

    def cycle(self, at_us: float) -> int:
        """The board's cycle at a world time."""
        return int(at_us * 1e-3 * self._cycles_per_ms)

    def us(self, cycle: float) -> float:
        """World time of a cycle of the board."""
        return cycle * 1e3 / self._cycles_per_ms

    def board_us(self, cycles: _Integers) -> _Integers:
        """The board's own time at its cycles, not wrapped."""
        return (cycles - int(self.board.exchange.booted)) // (NOMINAL_HZ // 1_000_000)

    def poll_every(self, every_ms: int, first_ms: int) -> None:
        """Poll the board by itself from a world time on; an ``every_ms`` of 0 ends it."""
        never = int(np.iinfo(np.int64).max)
        self._calls[kernel.POLL_AT_MS] = first_ms if every_ms else never
        self._calls[kernel.POLL_EVERY_MS] = every_ms

    def run(self, until_ms: int, stop_on_change: bool = False) -> None:
        """Run up to a world time, or until the board's state, fault or result changed.

        At most :data:`LOG_EVERY_MS` at once.
        """
        bench, cell, plant, board = self.bench, self.bench.loadcell, self.bench.plant, self.board
        if until_ms - bench.logged_ms > LOG_EVERY_MS:
            bench.log_truth()
        self._calls[kernel.STOP_ON_CHANGE] = stop_on_change
        kernel.run(
            plant.state,
            plant.constants,
            plant.log,
            plant.footprint,
            cell.state,
            cell.given,
            cell.noise(until_ms * 1000),
            board.words,
            board.reals,
            board.poll_words,
            self._clock,
            self._wires,
            self._calls,
            self._conversions,
            self._poll_words,
            self._polled_ms,
            until_ms,
        )
        if board.exchange.edge_count:
            self._pass_edges()

    def conversions(self) -> tuple[_Integers, _Integers]:
        """Cycles and counts of the load-cell samples that the board took in the last run."""
        rows = self._conversions[: self._calls[kernel.CONVERSIONS]]
        return rows[:, 0].copy(), rows[:, 1].copy()

    def polls(self) -> tuple[NDArray[np.uint16], _Integers]:
        """Poll blocks of the last run, uint16 (n, 40), and the world's millisecond of each."""
        count = int(self._calls[kernel.POLLS])
        return self._poll_words[:count].copy(), self._polled_ms[:count].copy()

    def disturb(self) -> None:
        """Bring changed disturbances to the board's pins and to the mechanics."""
        p, wrong, x = self.bench.parameters, self.bench.disturbances, self.board.exchange
        self._wires[:] = [
            signal in wires
            for signal in (Signal.END_SWITCHES, Signal.POSITION)
            for wires in (wrong.absent, wrong.inverted)
        ]
        there = Signal.INDEX not in wrong.absent
        x.mark_length_steps = there * round(p.index_length_mm / p.mm_per_step)
        x.mark_inverted = int(Signal.INDEX in wrong.inverted)
        x.motor_jammed = int(wrong.motor_jammed)
        self.board.set_estop(int(wrong.wire(Signal.ESTOP, wrong.estop_pressed)))
        self.bench.disturb()

    def reset(self) -> None:
        """Press the board's reset button."""
        self.board.boot(1 << ResetCause.EXTERNAL)
        self._pass_edges()

    def _pass_edges(self) -> None:
        for cycle, signal, level in self.board.take_edges():
            at_us = int(self.us(cycle))
            if signal == SYNC:
                self.bench.sync(level, at_us)
            else:
                self.on_mark(level, at_us)


def _nobody(level: int, at_us: int) -> None:
    """Hear of an edge when nobody else does."""
