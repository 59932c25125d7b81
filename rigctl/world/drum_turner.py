"""The virtual drum's steps: moves, the sync window counted in steps, and the index mark."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from rigctl.world.bench import Bench
from rigctl.world.drum_motion import DrumMotion, Trapezoid

HOME_MM_S = 60.0
HOME_TURNS = 1.25
TARE_MM_S = 40.0
TARE_TURNS = 1.0625
INDEX_TOLERANCE_STEPS = 4

Done = Callable[[], None]


class Turner:
    """Drum angle and sync line of one boot of the board. Times are world microseconds."""

    def __init__(self, bench: Bench, motion: DrumMotion, clock: float, at_us: int) -> None:
        self._bench = bench
        self._clock = clock
        self.turn_steps = round(bench.parameters.steps_per_turn)
        self.step_mm = bench.parameters.mm_per_step
        self.motion = motion
        self.zero_mm = motion.travel_mm(at_us)
        self.sync_high = False
        self.sync_count = 0
        self.sync_rise_us = self.sync_fall_us = at_us
        self.index_count = self.index_error_steps = 0
        self.homed = False
        self.homing = False
        self._mark_steps = 0
        self._sync_fitted, self._sync_inverted = True, False

    def wire_sync(self, fitted: bool, inverted: bool, at_us: int) -> None:
        """How the sync line is wired; the pin shows it at once."""
        self._sync_fitted, self._sync_inverted = fitted, inverted
        self._show_sync(self.sync_high, at_us)

    def steps(self, at_us: int) -> int:
        """Signed microsteps since the zero."""
        return math.floor((self.motion.travel_mm(at_us) - self.zero_mm) / self.step_mm + 1e-6)

    def angle_steps(self, at_us: int) -> int:
        """Place within the turn, in steps."""
        return self.steps(at_us) % self.turn_steps

    def turn_share(self, at_us: int) -> float:
        """Place within the turn, 0 to 1, by the steps."""
        return self.angle_steps(at_us) / self.turn_steps

    def angle_rad(self, at_us: int) -> float:
        """Place within the turn by the steps."""
        return 2.0 * math.pi * self.angle_steps(at_us) / self.turn_steps

    def rate_rad_s(self, at_us: int) -> float:
        """Signed turning rate."""
        return 2.0 * math.pi * self.motion.speed_mm_s(at_us) / (self.turn_steps * self.step_mm)

    def zero(self, at_us: int) -> None:
        """Count steps from here."""
        self.zero_mm = self.motion.travel_mm(at_us)
        self.homed = False

    def run(self, at_us: int, settings: Mapping[str, int], done: Done) -> None:
        """Turn over run-in and travel, sync high over the travel, then ramp down."""
        speed = 0.01 * settings["speed_set"] * self._rate(settings)
        acceleration = settings["acceleration_set"] * self._rate(settings)
        rise_mm = self._whole(0.1 * settings["run_in_set"])
        fall_mm = rise_mm + self._whole(0.1 * settings["travel_set"])
        shape = Trapezoid(fall_mm + 0.5 * speed**2 / acceleration, speed, acceleration)
        sign = -1 if settings["direction_set"] else 1
        marks = [(rise_mm, self._rise), (fall_mm, self._fall)]
        self.motion.start(at_us, shape, sign, marks, lambda now_us: done())

    def run_in_suffices(self, settings: Mapping[str, int]) -> bool:
        """The ramp and its settling end before the trial window opens."""
        speed = 0.01 * settings["speed_set"]
        ramp_mm = speed**2 / (2.0 * settings["acceleration_set"])
        settling_mm = 1e-3 * settings["run_settle_ms"] * speed
        return 0.1 * settings["run_in_set"] >= ramp_mm + settling_mm + 2.0 * self.step_mm

    def move(self, at_us: int, settings: Mapping[str, int], done: Done) -> None:
        """Go to ``move_target`` lifted; at once done when it is here."""
        distance = settings["move_target"] - self.steps(at_us)
        if distance == 0:
            self.motion.brake(at_us, 1.0, lambda now_us: done())
            return
        self._go(at_us, settings, 0.01 * settings["move_speed_set"], distance, done)

    def tare_turn(self, at_us: int, settings: Mapping[str, int], done: Done) -> None:
        """A turn at constant speed, and its ramps."""
        ramps_mm = TARE_MM_S**2 / settings["acceleration_set"]
        steps = round(ramps_mm / self.step_mm) + round(TARE_TURNS * self.turn_steps)
        self._go(at_us, settings, TARE_MM_S, steps, done)

    def home(self, at_us: int, settings: Mapping[str, int], done: Done) -> None:
        """Seek the index mark forwards; the mark's leading edge becomes step 0."""
        self.homing = True
        self.homed = False
        self._go(at_us, settings, HOME_MM_S, round(HOME_TURNS * self.turn_steps), done)

    def brake(self, at_us: int, settings: Mapping[str, int], done: Done) -> None:
        """Ramp down and forget what was planned; the window closes."""
        self._fall(at_us)
        self.homing = False
        self.motion.brake(at_us, settings["acceleration_set"], lambda now_us: done())

    def halt(self, at_us: int) -> None:
        """No more steps from now on; anybody may turn a drum that is off."""
        self._fall(at_us)
        self.homing = self.homed = False
        self.motion.halt(at_us)

    def mark(self, at_us: int, settings: Mapping[str, int], done: Done) -> bool:
        """An index mark began; True when the steps counted since the last one are right."""
        self.index_count += 1
        if self.homing:
            self.zero_mm = self.motion.travel_mm(at_us)
            self._mark_steps, self.index_error_steps, self.homed = 0, 0, True
            self.brake(at_us, settings, done)
            return True
        if not self.homed:
            return True
        steps = self.steps(at_us)
        if self.motion.speed_mm_s(at_us) < 0.0:
            steps -= round(self._bench.parameters.index_length_mm / self.step_mm)
        half = self.turn_steps // 2
        self.index_error_steps = (steps + half) % self.turn_steps - half
        self._mark_steps = steps - self.index_error_steps
        return abs(self.index_error_steps) <= INDEX_TOLERANCE_STEPS

    def mark_missed(self, at_us: int) -> bool:
        """More than a turn was counted since the last index mark."""
        margin = 2 * round(self._bench.parameters.index_length_mm / self.step_mm)
        since = abs(self.steps(at_us) - self._mark_steps)
        return self.homed and since > self.turn_steps + margin

    def speed_set_mm_s(self, at_us: int, settings: Mapping[str, int]) -> float:
        """Speed now in the units of the set-points: by the board's trimmed clock."""
        return self.motion.speed_mm_s(at_us) / self._rate(settings)

    def _rate(self, settings: Mapping[str, int]) -> float:
        """True speed over speed asked for."""
        return self._clock / (1.0 + settings["clock_trim_ppm"] * 1e-6)

    def _whole(self, travel_mm: float) -> float:
        return round(travel_mm / self.step_mm) * self.step_mm

    def _go(
        self, at_us: int, settings: Mapping[str, int], speed: float, steps: int, done: Done
    ) -> None:
        rate = self._rate(settings)
        acceleration = settings["acceleration_set"] * rate
        shape = Trapezoid(abs(steps) * self.step_mm, speed * rate, acceleration)
        sign = 1 if steps > 0 else -1
        self.motion.start(at_us, shape, sign, [], lambda now_us: done())

    def _rise(self, at_us: int) -> None:
        self.sync_high, self.sync_rise_us = True, at_us
        self.sync_count += 1
        self._show_sync(True, at_us)

    def _fall(self, at_us: int) -> None:
        if self.sync_high:
            self.sync_high, self.sync_fall_us = False, at_us
            self._show_sync(False, at_us)

    def _show_sync(self, on: bool, at_us: int) -> None:
        self._bench.sync(int((on and self._sync_fitted) != self._sync_inverted), at_us)
