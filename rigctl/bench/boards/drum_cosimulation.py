"""Co-simulation of a bench and the drum's virtual board."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.bench import LOG_EVERY_MS, Bench
from rigctl.bench.boards import kernel
from rigctl.bench.boards.drum_firmware import SYNC, DrumFirmware
from rigctl.boards.drum_codes import ResetCause
from rigctl.boards.drum_registers import POLL_BLOCK

NOMINAL_HZ = 16_000_000
MAX_CONVERSIONS = LOG_EVERY_MS
MAX_POLLS = 64
_Integers = NDArray[np.int64]


class DrumCosimulation:
    """Runs a bench and its drum board in whole milliseconds.

    ``on_index(level, at_us)``, if set, receives the index mark's edges; the bench receives those of
    the sync line. Raises RigFault if the board's library cannot be used.
    """

    def __init__(self, bench: Bench, library: Path | None = None) -> None:
        p = bench.parameters
        self.bench = bench
        self.firmware = DrumFirmware(library)
        self.on_index: Callable[[int, int], None] | None = None
        self._cycles_per_ms = NOMINAL_HZ / 1000 * (1.0 + p.drum_clock_ppm * 1e-6)
        start_steps = round(p.start_mm / p.mm_per_step)
        self._scales = np.array(
            [self._cycles_per_ms, start_steps, p.mm_per_step, p.actuator_travel_mm]
        )
        self._control = kernel.new_control(self.firmware.handle, self.firmware.addresses)
        self._conversions = np.zeros((MAX_CONVERSIONS, 2), np.int64)
        self._polls = np.zeros((MAX_POLLS, POLL_BLOCK[1]), np.uint16)
        self._polls_ms = np.zeros(MAX_POLLS, np.int64)
        self._results = self._conversions, self._polls, self._polls_ms
        self.apply_disturbances()
        self.firmware.place_drum(start_steps)
        self.firmware.boot(1 << ResetCause.POWER_ON)
        self._dispatch_edges()

    @property
    def time_ms(self) -> int:
        return self.bench.plant.time_ms

    def cycle(self, at_us: float) -> int:
        """Return the board's cycle at a simulated time."""
        return int(at_us * 1e-3 * self._cycles_per_ms)

    def us(self, cycle: float) -> float:
        """Return the simulated time of a cycle of the board."""
        return cycle * 1e3 / self._cycles_per_ms

    def board_us(self, cycles: _Integers) -> _Integers:
        """Return the board's own time at these cycles, not wrapped."""
        return (cycles - int(self.firmware.io.boot_cycle)) // (NOMINAL_HZ // 1_000_000)

    def poll_every(self, every_ms: int, first_ms: int) -> None:
        """Poll the board periodically from a time on; an ``every_ms`` of 0 stops polling."""
        never = int(np.iinfo(np.int64).max)
        self._control[kernel.POLL_AT_MS] = first_ms if every_ms else never
        self._control[kernel.POLL_EVERY_MS] = every_ms

    def run(self, until_ms: int, stop_on_change: bool = False) -> None:
        """Run up to a time, or until the board's state, fault or result changes.

        At most :data:`LOG_EVERY_MS` in one call.
        """
        bench, firmware = self.bench, self.firmware
        if until_ms - bench.logged_ms > LOG_EVERY_MS:
            bench.log_truth()
        self._control[kernel.STOP_ON_CHANGE] = stop_on_change
        kernel.run(
            bench.plant.arrays,
            bench.loadcell.arrays,
            bench.loadcell.noise(),
            firmware.arrays,
            self._scales,
            bench.electrics,
            self._control,
            self._results,
            until_ms,
        )
        if firmware.io.edge_count:
            self._dispatch_edges()

    def conversions(self) -> tuple[_Integers, _Integers]:
        """Return cycles and counts of the load-cell samples that the board took in the last run."""
        rows = self._conversions[: self._control[kernel.CONVERSIONS]]
        return rows[:, 0].copy(), rows[:, 1].copy()

    def polls(self) -> tuple[NDArray[np.uint16], _Integers]:
        """Return poll blocks of the last run, uint16 (n, 40), and the time of each in ms."""
        count = int(self._control[kernel.POLLS])
        return self._polls[:count].copy(), self._polls_ms[:count].copy()

    def apply_disturbances(self) -> None:
        """Pass changed disturbances to the board's pins and to the mechanics."""
        self.bench.wire_drum(self.firmware.io)
        self.bench.apply_disturbances()
        self.firmware.set_estop(int(self.bench.disturbances.estop_level()))

    def reset(self) -> None:
        self.firmware.boot(1 << ResetCause.EXTERNAL)
        self._dispatch_edges()

    def _dispatch_edges(self) -> None:
        for cycle, signal, level in self.firmware.take_edges():
            at_us = int(self.us(cycle))
            if signal == SYNC:
                self.bench.set_sync(level, at_us)
                continue
            at_taxels = self.bench.index_at_taxels(level)
            if self.on_index is not None and at_taxels is not None:
                self.on_index(at_taxels, at_us)
