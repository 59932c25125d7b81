"""The taxels' virtual board on the bench: when frames are due and what the sensor gives them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.bench import Bench
from rigctl.simulation.bench.skin import SLOT_US
from rigctl.simulation.boards.taxel_firmware import INDEX, SYNC, TaxelFirmware

FRAME_US = 1000
CYCLES_PER_FRAME = 16_000
FLUSH_US = 20_000
"""The cable hands over what came in this time: the latency timer of common USB adapters."""

SEND_US = 700
"""From the end of a frame's samples to the last byte of the frame."""

BOOT_US = 5_000
POWER_ON, EXTERNAL = 1, 2


class VirtualTaxels:
    """The taxel board from power-up on. Times are world microseconds.

    Raises RigFault where the board's library cannot be used.
    """

    def __init__(self, bench: Bench, library: Path | None = None) -> None:
        self._bench = bench
        self.board = TaxelFirmware(library)
        self.frame_us = FRAME_US / (1.0 + bench.parameters.taxel_clock_ppm * 1e-6)
        self._frames_ever = 0
        self._boot(0, POWER_ON)

    def reset(self, now_us: int) -> None:
        """The reset button: counters start anew."""
        self._boot(now_us, EXTERNAL)

    def _boot(self, at_us: int, cause: int) -> None:
        self._origin_us = at_us + BOOT_US
        self._closed = 0
        self.board.boot(cause)
        self.sync_edge(self._bench.sync_level, at_us)

    def sync_edge(self, level: int, at_us: int) -> None:
        """The drum board drives the sync line."""
        self.board.edge(SYNC, level, self._cycle(at_us))

    def mark_edge(self, level: int, at_us: int) -> None:
        """The index mark comes under its sensor, or leaves it."""
        self.board.edge(INDEX, level, self._cycle(at_us))

    def frame_at(self, at_us: float) -> int:
        """Number of the first frame that starts at or after a world time."""
        return math.ceil((at_us - self._origin_us) / self.frame_us)

    def start_us(self, frame: int) -> float:
        """World time at which a frame starts."""
        return self._origin_us + frame * self.frame_us

    def complete(self, now_us: float) -> int:
        """How many frames have ended by a world time."""
        return int((now_us - self._origin_us) / self.frame_us)

    def send(self, now_us: int) -> bytes:
        """Send the frames whose last byte is out by now; returns all that was sent."""
        due = self.complete(now_us - SEND_US) - self._closed
        if due > 0:
            self._bench.skin.advance()
            self.board.run(self._readings(due))
        return self.board.take_sent()

    def take(
        self, first: int, behind: int
    ) -> tuple[NDArray[np.uint16], NDArray[np.uint8], NDArray[np.uint8]]:
        """Close frames unsent up to ``behind``; samples, flags and edges from ``first`` on.

        uint16 (n, 18), uint8 (n,), uint8 (n,). Frames come in rising order, felt already.
        """
        self.board.pass_frames(first - self._closed)
        self._closed = self._frames_ever = first
        self._bench.skin.advance()
        samples = self._readings(behind - first)
        return samples, *self.board.pass_frames(behind - first)

    def _readings(self, count: int) -> NDArray[np.uint16]:
        numbers = np.arange(self._closed, self._closed + count, dtype=np.float64)
        starts: NDArray[np.float64] = self._origin_us + numbers * self.frame_us
        slot_us = SLOT_US * self.frame_us / FRAME_US
        samples = self._bench.skin.read(self._frames_ever, starts, slot_us)
        self._closed += count
        self._frames_ever += count
        return samples

    def _cycle(self, at_us: int) -> int:
        return math.floor((at_us - self._origin_us) / self.frame_us * CYCLES_PER_FRAME)
