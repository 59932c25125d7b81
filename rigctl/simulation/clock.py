"""An asyncio loop whose clock is the world's.

The loop's selector advances the simulation when no task is ready, never past the earliest
timer. So every timeout, poll and heartbeat of the host lives in world time, and a run is the
same for a seed whatever the machine does. Sockets, pipes and ``call_soon_threadsafe`` are
served as in any loop, once a slice.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from typing import Any

from rigctl.simulation.simulated_rig import SimulatedRig

CLOCK_RESOLUTION_S = 1e-6
LAG_FORGOTTEN_S = 0.5
"""A paced world that is later than this is not hurried to catch up: people watch it."""

FREE_LOOKS = 8
"""A free-running world looks at files once in so many turns: each look is a system call, and
nothing that comes through a file may decide a sample there."""

_Ready = list[tuple[selectors.SelectorKey, int]]


class _WorldSelector(selectors.DefaultSelector):
    """Waits for files by letting the world go on."""

    def __init__(self, simulation: SimulatedRig, pace: float | None) -> None:
        super().__init__()
        self._simulation = simulation
        self._pace = pace
        self.dropped_s = 0.0
        self._turns = 0
        self._anchor()

    def select(self, timeout: float | None = None) -> _Ready:
        ready = self._look()
        if (timeout is not None and timeout <= 0) or (ready and self._pace is None):
            return ready
        now_us = self._simulation.time_us
        until_us = now_us + self._simulation.slice_us
        if timeout is not None:
            until_us = min(until_us, now_us + max(1, round(timeout * 1e6)))
        if self._pace is None:
            self._simulation.advance(until_us)
            return ready
        return self._paced(until_us, ready, self._pace)

    def _look(self) -> _Ready:
        """Files that are ready; where the world runs free, seen a few turns late."""
        self._turns += 1
        if self._pace is None and self._turns % FREE_LOOKS:
            return []
        return super().select(0)

    def lag_s(self) -> float:
        """How far the world is behind the wall clock now; 0 when not paced."""
        if self._pace is None:
            return 0.0
        return max(0.0, (self._due_us() - self._simulation.time_us) / 1e6)

    def _paced(self, until_us: int, ready: _Ready, pace: float) -> _Ready:
        early_us = until_us - self._due_us()
        if early_us > 0 and not ready:
            ready = super().select(early_us / (1e6 * pace))
        if -early_us > LAG_FORGOTTEN_S * 1e6:
            self.dropped_s += -early_us / 1e6
            self._anchor()
        if ready:
            # A file woke the loop early: the world stops where the wall clock is.
            until_us = min(until_us, self._due_us())
        if until_us > self._simulation.time_us:
            self._simulation.advance(until_us)
        return ready

    def _anchor(self) -> None:
        self._wall_s = time.monotonic()
        self._world_us = self._simulation.time_us

    def _due_us(self) -> int:
        elapsed_s = time.monotonic() - self._wall_s
        return self._world_us + int(elapsed_s * (self._pace or 1.0) * 1e6)


class SimulatedTimeLoop(asyncio.SelectorEventLoop):
    """The loop of a simulated rig: ``time()`` is world time in seconds.

    ``pace`` None runs as fast as the processor allows, 1.0 in real time. Closing the loop does
    not close the simulation.
    """

    def __init__(self, simulation: SimulatedRig, pace: float | None = None) -> None:
        self.simulation = simulation
        self.pace = pace
        self._world_selector = _WorldSelector(simulation, pace)
        super().__init__(self._world_selector)
        # asyncio treats timers within this span as due; the world counts whole microseconds.
        self._clock_resolution: Any = CLOCK_RESOLUTION_S

    def time(self) -> float:
        """World time, s."""
        return self.simulation.time_us / 1e6

    @property
    def lag_s(self) -> float:
        """How late a paced world is now, s of world time."""
        return self._world_selector.lag_s()

    @property
    def dropped_s(self) -> float:
        """World time that a paced world gave up catching up with since it began, s."""
        return self._world_selector.dropped_s
