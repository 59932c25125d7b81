"""Moves of the virtual drum: trapezoids of speed, exact to the step and to the microsecond."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from rigctl.world.plant import STANDING, Motion

Action = Callable[[int], None]


class Trapezoid(NamedTuple):
    """From rest over ``distance_mm`` to rest, at most ``speed_mm_s`` fast; all positive."""

    distance_mm: float
    speed_mm_s: float
    acceleration_mm_s2: float

    @property
    def peak_mm_s(self) -> float:
        """The speed really reached."""
        return min(self.speed_mm_s, math.sqrt(self.distance_mm * self.acceleration_mm_s2))

    @property
    def ramp_s(self) -> float:
        """Length of each ramp."""
        return self.peak_mm_s / self.acceleration_mm_s2

    @property
    def ramp_mm(self) -> float:
        """Travel of each ramp."""
        return 0.5 * self.peak_mm_s * self.ramp_s

    @property
    def cruise_s(self) -> float:
        """Time at constant speed."""
        return (self.distance_mm - 2.0 * self.ramp_mm) / self.peak_mm_s

    @property
    def duration_s(self) -> float:
        """Time from rest to rest."""
        return 2.0 * self.ramp_s + self.cruise_s

    def time_at(self, travel_mm: float) -> float:
        """Seconds after the start at which the travel is reached."""
        if travel_mm <= self.ramp_mm:
            return math.sqrt(2.0 * travel_mm / self.acceleration_mm_s2)
        left_mm = self.distance_mm - travel_mm
        if left_mm <= self.ramp_mm:
            return self.duration_s - math.sqrt(2.0 * max(left_mm, 0.0) / self.acceleration_mm_s2)
        return self.ramp_s + (travel_mm - self.ramp_mm) / self.peak_mm_s


class DrumMotion:
    """What the steps do now, and what they will do when nothing intervenes.

    ``motion`` is handed to the plant. Times are world microseconds; whoever owns this must call
    :meth:`pass_time` at every ``next_us``.
    """

    def __init__(self) -> None:
        self.motion = STANDING
        self._plan: list[tuple[int, Motion | None, Action | None]] = []

    @property
    def moving(self) -> bool:
        """Steps are made now."""
        return self.motion.speed_mm_s != 0.0 or self.motion.acceleration_mm_s2 != 0.0

    @property
    def constant(self) -> bool:
        """Turning at constant speed."""
        return self.moving and self.motion.acceleration_mm_s2 == 0.0

    @property
    def next_us(self) -> float:
        """When something changes; infinite when nothing is planned."""
        return self._plan[0][0] if self._plan else math.inf

    def travel_mm(self, at_us: int) -> float:
        """Nominal travel since power-up."""
        return self.motion.travel_at(at_us)

    def speed_mm_s(self, at_us: int) -> float:
        """Signed speed."""
        m = self.motion
        return m.speed_mm_s + m.acceleration_mm_s2 * (at_us - m.from_us) * 1e-6

    def start(
        self,
        at_us: int,
        shape: Trapezoid,
        sign: int,
        marks: Sequence[tuple[float, Action]],
        done: Action,
    ) -> None:
        """Begin a move from rest. ``marks``: calls at travels from here, mm."""
        start_mm = self.travel_mm(at_us)
        a = sign * shape.acceleration_mm_s2
        v = sign * shape.peak_mm_s
        cruise_s, brake_s = shape.ramp_s, shape.ramp_s + shape.cruise_s
        cruise_mm, brake_mm = shape.ramp_mm, shape.distance_mm - shape.ramp_mm
        end_mm = start_mm + sign * shape.distance_mm
        self.motion = Motion(float(at_us), start_mm, 0.0, a)
        phases = [
            (cruise_s, Motion(at_us + 1e6 * cruise_s, start_mm + sign * cruise_mm, v, 0.0)),
            (brake_s, Motion(at_us + 1e6 * brake_s, start_mm + sign * brake_mm, v, -a)),
            (shape.duration_s, Motion(float(at_us), end_mm, 0.0, 0.0)),
        ]
        plan = [(at_us + round(1e6 * t), motion, None) for t, motion in phases]
        calls = [(at_us + round(1e6 * shape.time_at(mm)), None, call) for mm, call in marks]
        end = (plan[-1][0], None, done)
        self._plan = sorted([*plan, *calls], key=lambda entry: entry[0])
        self._plan.append(end)

    def brake(self, at_us: int, acceleration_mm_s2: float, done: Action | None = None) -> None:
        """Ramp down from whatever speed there is."""
        speed, here_mm = self.speed_mm_s(at_us), self.travel_mm(at_us)
        self.halt(at_us)
        if speed == 0.0:
            self._plan = [(at_us, None, done)] if done else []
            return
        seconds = abs(speed) / acceleration_mm_s2
        end_mm = here_mm + 0.5 * speed * seconds
        self.motion = Motion(
            float(at_us), here_mm, speed, -math.copysign(acceleration_mm_s2, speed)
        )
        end_us = at_us + math.ceil(1e6 * seconds)
        self._plan = [(end_us, Motion(float(at_us), end_mm, 0.0, 0.0), done)]

    def halt(self, at_us: int) -> None:
        """Stand still at once where the drum is now, and forget all plans."""
        self.motion = Motion(float(at_us), self.travel_mm(at_us), 0.0, 0.0)
        self._plan = []

    def pass_time(self, at_us: int) -> None:
        """Do what is due."""
        while self._plan and self._plan[0][0] <= at_us:
            _, motion, call = self._plan.pop(0)
            if motion is not None:
                self.motion = motion
            if call is not None:
                call(at_us)
