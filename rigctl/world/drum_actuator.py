"""The virtual drum's hand on the actuator: wanted speeds to duty, lifts, end switches."""

from __future__ import annotations

import math

from rigctl.world.plant import Plant

FULL_SPEED_MM_S = 10.0
"""Speed at full duty as the board believes it."""

LEAST_SPEED_MM_S = 0.15
"""Slower than this the actuator is moved in pulses."""

PERIOD_S = 0.0125
END_MM = 0.02
NO_LIMITS = (-1.0, math.inf)


class ActuatorDrive:
    """``duty`` (−1 … 1, positive presses) and ``limits_mm`` are what the plant is given."""

    def __init__(self, plant: Plant, travel_mm: float, counts: float) -> None:
        self._plant = plant
        self.travel_mm = travel_mm
        self.mm_per_count = travel_mm / counts
        self.owed_mm = 0.0
        self.duty = 0.0
        self.limits_mm = NO_LIMITS

    @property
    def position_mm(self) -> float:
        """Travel from the upper end by the potentiometer."""
        return self._plant.potentiometer * self.mm_per_count

    @property
    def at_upper_end(self) -> bool:
        """The upper end switch is open."""
        return self._plant.rod_mm <= END_MM

    @property
    def at_lower_end(self) -> bool:
        """The lower end switch is open."""
        return self._plant.rod_mm >= self.travel_mm - END_MM

    def off(self) -> None:
        """No drive; the screw holds by itself."""
        self.duty = 0.0
        self.owed_mm = 0.0
        self.limits_mm = NO_LIMITS

    def ask(self, speed_mm_s: float, dead_band: float) -> float:
        """Move at a speed for the next period; returns the speed really asked."""
        self.owed_mm += speed_mm_s * PERIOD_S
        if abs(speed_mm_s) < LEAST_SPEED_MM_S:
            pulse = abs(self.owed_mm) >= LEAST_SPEED_MM_S * PERIOD_S
            speed_mm_s = math.copysign(LEAST_SPEED_MM_S, self.owed_mm) if pulse else 0.0
        self.owed_mm = 0.0 if speed_mm_s else self.owed_mm
        share = min(1.0, abs(speed_mm_s) / FULL_SPEED_MM_S)
        duty = dead_band + (1.0 - dead_band) * share if speed_mm_s else 0.0
        self.duty = math.copysign(duty, speed_mm_s)
        return speed_mm_s

    def press_until(self, limit_mm: float) -> None:
        """While pressing, the plant reports this travel or the lower end."""
        self.limits_mm = (-1.0, min(limit_mm, self.travel_mm - END_MM))

    def lift_to(self, target_mm: float) -> bool:
        """Lift at full speed until the travel is reached; True when it is already."""
        target_mm = max(target_mm, END_MM)
        if self._plant.rod_mm <= target_mm:
            self.off()
            return True
        self.duty = -1.0
        self.limits_mm = (target_mm, math.inf)
        return False
