"""The virtual drum pressed on the sensor: search, contact, held force or depth, settled or not."""

from __future__ import annotations

import math

from rigctl.wire.drum_map import ForceMode, Signal
from rigctl.world.bench import Bench
from rigctl.world.drum_actuator import ActuatorDrive
from rigctl.world.drum_force import ForceLoop, Target
from rigctl.world.drum_loadcell import LoadcellWatch
from rigctl.world.drum_registers import RegisterBank
from rigctl.world.drum_step_test import StepTest
from rigctl.world.drum_turner import Turner

FAR_MM_S, SEARCH_MM_S, MOST_MM_S = 8.0, 2.5, 10.0
NEAR_MM = 1.5
POSITION_BAND_MM = 0.06
POSITION_REST_MM = 0.03
POSITION_GAIN = 4.0


class Presser:
    """One contact after the other. ``contact_mm`` is where the last one was found."""

    def __init__(self, bench: Bench, bank: RegisterBank, cell: LoadcellWatch, clock: float) -> None:
        p = bench.parameters
        self._bank = bank
        self._cell = cell
        self._clock = clock
        self.actuator = ActuatorDrive(bench.plant, p.actuator_travel_mm, p.potentiometer_counts)
        self.force = ForceLoop()
        self.contact_mm: float | None = None
        self.settled = False
        self.step_test: StepTest | None = None
        self.outside_us = 0

    @property
    def in_contact(self) -> bool:
        """The drum rests on the sensor."""
        return self.force.in_contact

    def begin(self, now_us: int) -> None:
        """Start to press down from free air."""
        self.outside_us = now_us
        self.force.begin(float(self._setting("stiffness_g_per_mm")), self._cell.force_g)
        limit_mm = 1e-3 * self._setting("approach_limit_um")
        here_mm = self.actuator.position_mm if self._has_position else math.inf
        self.actuator.press_until(here_mm + limit_mm)

    def lift(self, clearance_mm: float = math.inf) -> None:
        """Lift at full speed, so far above the contact if that is known; contact is over."""
        self.force.in_contact = False
        known_mm = self.contact_mm if self._has_position else None
        self.actuator.lift_to(0.0 if known_mm is None else known_mm - clearance_mm)

    def step(self, now_us: int, turner: Turner, approaching: bool) -> None:
        """One step of the loop, with each reading of the load cell."""
        touched = self.in_contact
        angle, rate = turner.angle_rad(now_us), turner.rate_rad_s(now_us)
        speed = self.force.sample(self._cell.force_g, self._target(), angle, rate)
        if self.in_contact and not touched:
            self._touch(now_us)
        if self.in_contact:
            speed = self._other_mode(speed, approaching)
        asked = self.actuator.ask(speed, 1e-3 * self._setting("dead_band_permille"))
        self.force.commanded(asked)
        self._judge(now_us)

    def keep_stiffness(self) -> None:
        """Show the stiffness that was found, and begin with it next time."""
        stiffness = min(5000, max(50, round(self.force.stiffness_g_mm)))
        self._bank.put("stiffness_g_per_mm", stiffness)

    def begin_test(self) -> None:
        """Find gains at the force held now; ``step_test`` is the test."""
        self.step_test = StepTest(self._force_set_g(), self.force.stiffness_g_mm)

    @property
    def _has_position(self) -> bool:
        return bool(self._setting("optional_signals") >> Signal.POSITION & 1)

    def _setting(self, name: str) -> int:
        return self._bank.settings[name]

    def _force_set_g(self) -> float:
        return 0.1 * self._setting("force_set")

    def _touch(self, now_us: int) -> None:
        self.contact_mm = self.actuator.position_mm if self._has_position else None
        self.actuator.press_until(math.inf)
        self.outside_us = now_us

    def _target(self) -> Target:
        limit = MOST_MM_S
        if not self.in_contact:
            away_mm = (self.contact_mm or 0.0) - self.actuator.position_mm
            far = self._has_position and away_mm > NEAR_MM
            limit = FAR_MM_S if far else SEARCH_MM_S
        gain_p, gain_i = 0.01 * self._setting("gain_p"), 0.01 * self._setting("gain_i")
        return Target(self._force_set_g(), gain_p, gain_i, limit)

    def _other_mode(self, speed: float, approaching: bool) -> float:
        """LOCK rests once the force was reached; POSITION goes to a depth."""
        if self.step_test is not None and not self.step_test.finished:
            return self.step_test.sample(self._cell.force_g)
        if self._setting("force_mode") == ForceMode.HOLD:
            return speed
        if self._setting("force_mode") == ForceMode.LOCK:
            return speed if approaching else 0.0
        missing_mm = self._depth_missing_mm()
        return POSITION_GAIN * missing_mm if abs(missing_mm) >= POSITION_REST_MM else 0.0

    def _depth_missing_mm(self) -> float:
        if not self._has_position:
            return 1e-3 * self._setting("depth_set_um") - self.force.depth_mm
        wanted_mm = (self.contact_mm or 0.0) + 1e-3 * self._setting("depth_set_um")
        return wanted_mm - self.actuator.position_mm

    def _judge(self, now_us: int) -> None:
        if not self.in_contact or not self._inside_band():
            self.outside_us = now_us
        inside_ms = 1e-3 * self._clock * (now_us - self.outside_us)
        self.settled = inside_ms >= self._setting("settle_time_ms")

    def _inside_band(self) -> bool:
        if self._setting("force_mode") == ForceMode.POSITION:
            return abs(self._depth_missing_mm()) < POSITION_BAND_MM
        band_g = 1e-3 * self._setting("settle_band") * self._force_set_g()
        return abs(self._cell.force_g - self._force_set_g()) <= band_g
