"""A vertical axis by step and direction: a board that makes the pulses and counts them.

Its lines are ``G <step>`` (go there), ``S`` (stop) and, from the board ten times a second,
``P <step> <1 while it moves>``. Steps count from the lower end switch, 1,600 a millimetre.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rigctl.boards.links import ByteLink, OnBytes, OnLost, SerialLink
from rigctl.errors import LinkLost

STEPS_PER_MM = 1600
BAUD = 115_200
CONNECT_S = 2.0


class StepAxis:
    """The axis at one port."""

    height_mm: float | None = None
    is_moving = False

    def __init__(self, port: str, loop: asyncio.AbstractEventLoop) -> None:
        self._port: ByteLink
        self._port = SimulatedBoard(loop) if port == "simulated" else SerialLink(port, BAUD, loop)
        self._rest = b""
        self._reported = asyncio.Event()

    async def connect(self) -> None:
        """Open the port and wait for the first report."""
        self._port.open(self._receive, self._lose)
        try:
            await asyncio.wait_for(self._reported.wait(), CONNECT_S)
        except TimeoutError:
            raise LinkLost(f"{self._port.name}: no axis reports: check its cable") from None

    def move_to(self, height_mm: float) -> None:
        """Begin to move."""
        self.is_moving = True
        self._port.write(b"G %d\n" % round(height_mm * STEPS_PER_MM))

    def stop(self) -> None:
        """Stop at once."""
        if self._port.is_open:
            self._port.write(b"S\n")
        self.is_moving = False

    def close(self) -> None:
        """Stop and free the port."""
        self.stop()
        self._port.close()

    def _receive(self, data: bytes, at_s: float) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            kind, step, moves = line.split()
            if kind == b"P":
                self.height_mm, self.is_moving = int(step) / STEPS_PER_MM, moves == b"1"
                self._reported.set()

    def _lose(self, reason: str) -> None:
        self.height_mm, self.is_moving = None, False


class SimulatedBoard:
    """The board in memory: 10 mm/s, and a report every tenth of a second of the loop's time."""

    name = "simulated axis"
    resets_board = False
    is_open = False
    step_s, steps = 0.1, 10 * STEPS_PER_MM // 10

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._at = self._target = 0
        self._say: Callable[[bytes, float], None] = lambda data, at_s: None
        self._timer: asyncio.TimerHandle | None = None

    def open(self, on_bytes: OnBytes, on_lost: OnLost) -> None:
        """Begin to report."""
        self._say, self.is_open = on_bytes, True
        self._tick()

    def write(self, data: bytes) -> None:
        """Take one line."""
        kind, *step = data.split()
        self._target = int(step[0]) if kind == b"G" else self._at

    def close(self) -> None:
        """Report no more."""
        self.is_open = False
        if self._timer is not None:
            self._timer.cancel()

    def _tick(self) -> None:
        self._timer = self._loop.call_later(self.step_s, self._tick)
        self._at += max(-self.steps, min(self.steps, self._target - self._at))
        self._say(b"P %d %d\n" % (self._at, self._at != self._target), self._loop.time())
