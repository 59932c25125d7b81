"""An asyncio event loop that runs in simulated time.

The loop's selector advances the simulation when no task is ready, never past the earliest timer.
Every timeout, poll and heartbeat of the host therefore uses simulated time, and a run is
reproducible for a seed, whatever the machine's load. The loop serves sockets, pipes and
``call_soon_threadsafe`` as usual, once a slice.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from typing import Any, Protocol

CLOCK_RESOLUTION_S = 1e-6
MAX_LAG_S = 0.5
"""A paced simulation drops a longer lag instead of catching up: people are watching it."""

PACED_SLICE_US = 5_000
"""A paced simulation works in small steps, which end at multiples of this: what falls due there,
such as a delivery of the cable, is late by the cost of simulating the step, and not by its rest."""

TURNS_PER_SELECT = 8
"""A free-running simulation polls its files once in this many turns: each poll is a system call,
and no sample depends on what a file delivers."""


class TimedSimulation(Protocol):
    """What passes simulated time: a drum rig or a finger."""

    time_us: int

    @property
    def slice_us(self) -> int:
        """Longest useful advance from now, microseconds, at least 1."""

    def advance(self, until_us: int) -> None:
        """Simulate up to a time."""


_Ready = list[tuple[selectors.SelectorKey, int]]


class _SimulationSelector(selectors.DefaultSelector):
    """Advances the simulation instead of waiting for files."""

    def __init__(self, simulation: TimedSimulation, pace: float | None) -> None:
        super().__init__()
        self._simulation = simulation
        self._pace = pace
        self._turns = 0
        self._anchor()

    def select(self, timeout: float | None = None) -> _Ready:
        ready = self._poll()
        if (timeout is not None and timeout <= 0) or (ready and self._pace is None):
            return ready
        now_us = self._simulation.time_us
        until_us = now_us + self._slice_us()
        if timeout is not None:
            until_us = min(until_us, now_us + max(1, round(timeout * 1e6)))
        if self._pace is None:
            self._simulation.advance(until_us)
            return ready
        return self._advance_paced(until_us, ready, self._pace)

    def _slice_us(self) -> int:
        longest_us = self._simulation.slice_us
        if self._pace is None:
            return longest_us
        return min(longest_us, PACED_SLICE_US - self._simulation.time_us % PACED_SLICE_US)

    def _poll(self) -> _Ready:
        """Return the files that are ready; a free-running simulation sees them some turns late."""
        self._turns += 1
        if self._pace is None and self._turns % TURNS_PER_SELECT:
            return []
        return super().select(0)

    def _advance_paced(self, until_us: int, ready: _Ready, pace: float) -> _Ready:
        early_us = until_us - self._due_us()
        if early_us > 0 and not ready:
            ready = super().select(early_us / (1e6 * pace))
        if -early_us > MAX_LAG_S * 1e6:
            self._anchor()
        if ready:
            # A file ended the wait early: advance only to the present wall-clock time.
            until_us = min(until_us, self._due_us())
        if until_us > self._simulation.time_us:
            self._simulation.advance(until_us)
        return ready

    def _anchor(self) -> None:
        self._start_s = time.monotonic()
        self._start_us = self._simulation.time_us

    def _due_us(self) -> int:
        elapsed_s = time.monotonic() - self._start_s
        return self._start_us + int(elapsed_s * (self._pace or 1.0) * 1e6)


class SimulatedTimeLoop(asyncio.SelectorEventLoop):
    """The event loop of a simulated rig: ``time()`` is simulated time in seconds.

    A ``pace`` of None runs as fast as possible, 1.0 in real time. Closing the loop does not close
    the simulation.
    """

    def __init__(self, simulation: TimedSimulation, pace: float | None = None) -> None:
        self.simulation = simulation
        super().__init__(_SimulationSelector(simulation, pace))
        # asyncio treats timers within this span as due; simulated time is in whole microseconds.
        self._clock_resolution: Any = CLOCK_RESOLUTION_S

    def time(self) -> float:
        """Return simulated time, s."""
        return self.simulation.time_us / 1e6
