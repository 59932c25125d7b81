"""The virtual taxel board on the bench: frame timing and readings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.bench import Bench
from rigctl.simulation.bench.skin import SLOT_US
from rigctl.simulation.boards.taxel_firmware import INDEX, SYNC, TaxelFirmware

FRAME_US = 1000
CYCLES_PER_FRAME = 16_000
FLUSH_US = 20_000
"""Period in which the cable delivers bytes: the latency timer of common USB adapters."""

SEND_US = 700
"""Time from the end of a frame's samples to the frame's last byte."""

BOOT_US = 5_000
POWER_ON, EXTERNAL = 1, 2


class VirtualTaxels:
    """The taxel board from power-up on. Times are simulated microseconds.

    Raises RigFault if the board's library cannot be used.
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.firmware = TaxelFirmware()
        self.frame_us = FRAME_US / (1.0 + bench.parameters.taxel_clock_ppm * 1e-6)
        self._frames_since_power_up = 0
        self._boot(0, POWER_ON)

    def reset(self, now_us: int) -> None:
        """Press the reset button: the board's counters restart."""
        self._boot(now_us, EXTERNAL)

    def _boot(self, at_us: int, cause: int) -> None:
        self._origin_us = at_us + BOOT_US
        self._closed = 0
        self.firmware.boot(cause)
        self.set_sync(self._bench.sync_level, at_us)

    def set_sync(self, level: int, at_us: int) -> None:
        """Handle an edge of the sync line."""
        self.firmware.edge(SYNC, level, self._cycle(at_us))

    def set_index(self, level: int, at_us: int) -> None:
        """Handle an edge of the index mark's sensor."""
        self.firmware.edge(INDEX, level, self._cycle(at_us))

    def first_frame_from(self, at_us: float) -> int:
        """Return the number of the first frame that starts at or after a time."""
        return math.ceil((at_us - self._origin_us) / self.frame_us)

    def start_us(self, frame: int) -> float:
        """Return the time at which a frame starts."""
        return self._origin_us + frame * self.frame_us

    def ended_frames(self, now_us: float) -> int:
        """Return how many frames have ended by a time."""
        return int((now_us - self._origin_us) / self.frame_us)

    def send(self, now_us: int) -> bytes:
        """Send the frames whose last byte is out by now, and return the bytes."""
        due = self.ended_frames(now_us - SEND_US) - self._closed
        if due > 0:
            self._bench.skin.advance()
            self.firmware.run(self._readings(due))
        return self.firmware.take_sent()

    def read_frames(
        self, first: int, end: int
    ) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.uint8]]:
        """Close frames up to ``end`` unsent; return samples, flags and edges from ``first`` on.

        uint16 (n, 18), uint8 (n,), uint8 (n,). Callers read frames in ascending order.
        """
        self.firmware.close_frames(first - self._closed)
        self._closed = self._frames_since_power_up = first
        self._bench.skin.advance()
        samples = self._readings(end - first)
        return samples, *self.firmware.close_frames(end - first)

    def _readings(self, count: int) -> NDArray[np.uint16]:
        numbers = np.arange(self._closed, self._closed + count, dtype=np.float64)
        starts: NDArray[np.float64] = self._origin_us + numbers * self.frame_us
        slot_us = SLOT_US * self.frame_us / FRAME_US
        samples = self._bench.skin.read(self._frames_since_power_up, starts, slot_us)
        self._closed += count
        self._frames_since_power_up += count
        return samples

    def _cycle(self, at_us: int) -> int:
        return math.floor((at_us - self._origin_us) / self.frame_us * CYCLES_PER_FRAME)
