"""An accelerometer and gyroscope as a tracker: for slides between rests at the marks."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rigctl.boards.links import ByteLink
from rigctl.finger.trackers.lines import ImuLines
from rigctl.finger.trackers.streaming import SourceClock, StreamingTracker
from rigctl.finger.values import MARKS_MM
from rigctl.values import Position

REST_S = 0.25
"""The sensor rests where it was quiet for twice this time: the older half gives the bias."""
QUIET_M_S2, QUIET_RAD_S = 0.15, 0.03
"""Largest standard deviation at rest: some three times the noise of a common MEMS sensor."""
SLOW_MM_S = 50.0
"""A quiet sensor that moves faster than this slides evenly: it does not rest."""
MOST_AVERAGED = 400
"""Readings that the bias is the mean of: a longer rest follows a bias that drifts."""
LONGEST_MOVEMENT_S = 10.0
"""After this time the integral is worthless: positions are invalid until the next rest."""
MOST_MISSING_S = 0.05
"""A longer gap in the readings ends the integral."""

_Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Drift:
    """Errors at the end of a movement of ``seconds``: velocity before and place after ZUPT."""

    seconds: float
    velocity_mm_s: float
    place_mm: float


class ImuIntegrator:
    """Readings in, positions out: x along the plate in mm, y and z relative to the last rest."""

    def __init__(self, rest_places_mm: tuple[float, ...] = MARKS_MM) -> None:
        self.drifts: list[Drift] = []
        self._rest_places_mm = rest_places_mm
        self._window: deque[tuple[float, _Floats]] = deque()
        self._bias = np.zeros(6)
        self._averaged = 0
        self._resting = False
        self._rested_s = float("-inf")
        self._place_mm = np.array([rest_places_mm[0], 0.0, 0.0])
        self._velocity_mm_s = np.zeros(3)
        self._turn = Rotation.identity()
        self._force = np.zeros(3)
        self._known = False

    def add(
        self,
        at_s: float,
        acceleration_m_s2: tuple[float, float, float],
        turn_rad_s: tuple[float, float, float],
    ) -> Position:
        """Take a reading and return the position; it is invalid before the first rest."""
        reading = np.array([*acceleration_m_s2, *turn_rad_s])
        if self._window and at_s - self._window[-1][0] > MOST_MISSING_S:
            self._window.clear()
            self._known = self._resting = False
        self._window.append((at_s, reading))
        while self._window[-1][0] - self._window[0][0] > 2.0 * REST_S:
            self._window.popleft()
        if self._is_rest(at_s):
            self._rest(at_s)
        elif self._resting:
            self._leave()
        elif self._known:
            self._integrate(*self._window[-2], at_s, reading)
        valid = self._known and at_s - self._rested_s <= LONGEST_MOVEMENT_S
        x, y, z = self._place_mm.tolist()
        return Position(at_s, x, y, z, valid)

    def _is_rest(self, at_s: float) -> bool:
        if at_s - self._window[0][0] < 1.8 * REST_S:
            return False
        readings = np.array([reading for _, reading in self._window])
        spread = readings.std(axis=0)
        quiet = spread[:3].max() < QUIET_M_S2 and spread[3:].max() < QUIET_RAD_S
        moving = self._known and at_s - self._rested_s <= LONGEST_MOVEMENT_S
        slow = float(np.linalg.norm(self._velocity_mm_s)) < SLOW_MM_S
        return bool(quiet and (slow or not moving))

    def _rest(self, at_s: float) -> None:
        if self._known and not self._resting:
            self._end_movement(at_s)
        older = [reading for time_s, reading in self._window if time_s <= at_s - REST_S]
        if self._resting:
            self._averaged = min(self._averaged + 1, MOST_AVERAGED)
            self._bias = self._bias + (older[-1] - self._bias) / self._averaged
        else:
            self._averaged = len(older)
            self._bias = np.mean(older, axis=0)
        self._velocity_mm_s = np.zeros(3)
        self._resting = self._known = True
        self._rested_s = at_s

    def _end_movement(self, at_s: float) -> None:
        """Correct the place, note the drift, and rest at the nearest known place."""
        seconds = at_s - self._rested_s
        along_mm = float(self._place_mm[0] - 0.5 * self._velocity_mm_s[0] * seconds)
        nearest_mm = min(self._rest_places_mm, key=lambda place: abs(place - along_mm))
        drift = Drift(seconds, float(self._velocity_mm_s[0]), along_mm - nearest_mm)
        self.drifts.append(drift)
        self._place_mm = np.array([nearest_mm, 0.0, 0.0])

    def _leave(self) -> None:
        """Integrate the newer half of the window: the movement began somewhere in it."""
        self._resting = False
        self._turn = Rotation.identity()
        self._force = np.zeros(3)
        newest_s = self._window[-1][0]
        newer = [entry for entry in self._window if entry[0] > newest_s - REST_S]
        self._rested_s = newer[0][0]
        for before, after in pairwise(newer):
            self._integrate(*before, *after)

    def _integrate(self, before_s: float, before: _Floats, at_s: float, reading: _Floats) -> None:
        step_s = at_s - before_s
        turned = 0.5 * (before[3:] + reading[3:]) - self._bias[3:]
        self._turn = self._turn * Rotation.from_rotvec(turned * step_s)
        force = self._turn.apply(reading[:3]) - self._bias[:3]
        velocity = self._velocity_mm_s + 500.0 * (self._force + force) * step_s
        self._place_mm = self._place_mm + 0.5 * (self._velocity_mm_s + velocity) * step_s
        self._force, self._velocity_mm_s = force, velocity


class ImuTracker(StreamingTracker):
    """Positions integrated from lines of ``time_ms,ax,ay,az,gx,gy,gz``, x along the plate.

    ``integrator.drifts`` holds the error of each movement.
    """

    def __init__(
        self, link: ByteLink, loop: asyncio.AbstractEventLoop, latency_s: float = 0.0
    ) -> None:
        super().__init__(f"imu {link.name}", loop)
        self._link = link
        self._latency_s = latency_s
        self._restart()

    def _restart(self) -> None:
        self.integrator = ImuIntegrator()
        self._lines = ImuLines()
        self._clock = SourceClock(self._latency_s)

    def _begin(self) -> None:
        self._restart()
        self._link.open(self._receive, self._lose)

    def _end(self) -> None:
        self._link.close()

    def _receive(self, data: bytes, arrived_s: float) -> None:
        malformed, restarts = self._lines.malformed, self._clock.restarts
        for time_ms, acceleration, turn in self._lines.feed(data):
            at_s = self._clock.loop_s(time_ms / 1000.0, arrived_s)
            if at_s is None:
                self.counters.out_of_order += 1
            else:
                self._deliver(self.integrator.add(at_s, acceleration, turn))
        self.counters.malformed += self._lines.malformed - malformed
        self.counters.clock_restarts += self._clock.restarts - restarts
