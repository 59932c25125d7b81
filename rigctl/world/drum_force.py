"""The virtual drum's force loop: from load-cell readings to the speed asked of the actuator.

It thinks in millimetres of compression, force over stiffness. A model of the actuator tells
what a reading that is some milliseconds old does not show yet; what the model cannot explain is
learned as motion of the surface, a slow part and one period a turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

PERIOD_S = 0.0125
DELAY_S = 0.0075
LAG_S = 0.030
CONTACT_G = 8.0
BLIND_SAMPLES = 12
PRIOR_MM2 = 4e-4
FORGETTING = 0.96
MOST_DRIFT_MM_S = 1.0
MOST_RUN_OUT_MM = 0.5
SHARE_SEEN = 0.5
SHARE_LEARNED = 0.2
TURNING_RAD_S = 0.1

_DECAY = math.exp(-PERIOD_S / LAG_S)
_LATE = DELAY_S / PERIOD_S


@dataclass(frozen=True, slots=True)
class Target:
    """What the loop is to hold and how; ``limit_mm_s`` bounds its speed."""

    force_g: float
    gain_p: float
    gain_i: float
    limit_mm_s: float


def _within(value: float, bound: float) -> float:
    return max(-bound, min(bound, value))


class ForceLoop:
    """One contact, from touch to lift. Called once a load-cell sample."""

    def __init__(self) -> None:
        self.sine = self.cosine = self._last_rate = 0.0
        self.begin(600.0, 0.0)

    def begin(self, stiffness_g_mm: float, free_g: float) -> None:
        """Free of contact, about to press; ``free_g`` is the reading without load."""
        self.stiffness_g_mm = stiffness_g_mm
        self.in_contact = False
        self.depth_mm = 0.0
        self._samples = 0
        self._free_g = self._last_g = free_g
        self._command = self._speed = self._moved = 0.0
        self._shown = self._pending = 0.0
        self._compression = self._drift = 0.0
        self._sum_xx, self._sum_xy = PRIOR_MM2, PRIOR_MM2 * stiffness_g_mm

    @property
    def numbers(self) -> tuple[float, ...]:
        """All that it knows, in the order that :meth:`restore` takes."""
        return (
            self.sine,
            self.cosine,
            self.stiffness_g_mm,
            self.in_contact,
            self._samples,
            self._free_g,
            self._last_g,
            self._command,
            self._speed,
            self._moved,
            self._shown,
            self._pending,
            self._compression,
            self._drift,
            self._sum_xx,
            self._sum_xy,
            self._last_rate,
        )

    def restore(self, numbers: Sequence[float]) -> None:
        """Go on from these :attr:`numbers`."""
        self.sine, self.cosine, self.stiffness_g_mm = numbers[:3]
        self.in_contact, self._samples = bool(numbers[3]), int(numbers[4])
        self._free_g, self._last_g, self._command, self._speed, self._moved = numbers[5:10]
        self._shown, self._pending, self._compression, self._drift = numbers[10:14]
        self._sum_xx, self._sum_xy, self._last_rate = numbers[14:]

    def forget_run_out(self) -> None:
        """The drum's angle got a new zero."""
        self.sine = self.cosine = 0.0

    def commanded(self, speed_mm_s: float) -> None:
        """What was really asked of the actuator."""
        self._command = speed_mm_s

    def sample(self, force_g: float, target: Target, angle: float, rate: float) -> float:
        """Speed to ask for, mm/s, positive presses; ``angle`` and ``rate`` of the drum in rad."""
        self._advance_model()
        self._samples += 1
        if self.in_contact:
            if abs(rate) < TURNING_RAD_S:
                self._learn_stiffness(force_g)
            speed = self._hold(force_g, target, angle, rate)
        else:
            self._look_for_contact(force_g - self._free_g)
            speed = target.limit_mm_s
        self._last_g, self._last_rate = force_g, rate
        self._command = _within(speed, target.limit_mm_s)
        return self._command

    def _look_for_contact(self, rise_g: float) -> None:
        # The drum's own inertia looks like a force while the actuator gathers speed.
        if self._samples > BLIND_SAMPLES and rise_g > CONTACT_G:
            self.in_contact = True
            self._samples = 0
            self._compression = self.depth_mm = rise_g / self.stiffness_g_mm

    def _advance_model(self) -> None:
        before = self._moved
        settling = (self._speed - self._command) * LAG_S * (1.0 - _DECAY)
        self._moved = self._command * PERIOD_S + settling
        self._speed = self._command + (self._speed - self._command) * _DECAY
        self._shown = (1.0 - _LATE) * self._moved + _LATE * before
        self._pending = _LATE * self._moved
        self.depth_mm += self._moved

    def _learn_stiffness(self, force_g: float) -> None:
        if self._samples < 3 or abs(self._shown) < 0.004:
            return
        rise_g = force_g - self._last_g
        self._sum_xx = FORGETTING * self._sum_xx + self._shown**2
        self._sum_xy = FORGETTING * self._sum_xy + self._shown * rise_g
        self.stiffness_g_mm = min(5000.0, max(50.0, self._sum_xy / self._sum_xx))

    def _hold(self, force_g: float, target: Target, angle: float, rate: float) -> float:
        surprise = self._observe(force_g, angle, rate)
        self._drift = _within(self._drift + target.gain_i * surprise, MOST_DRIFT_MM_S)
        surface = self._drift + self._run_out_rate(angle + rate * LAG_S, rate)
        now_mm = self._compression + self._pending + surface * DELAY_S
        wanted_mm = target.force_g / self.stiffness_g_mm
        return target.gain_p * (wanted_mm - now_mm) - surface

    def _observe(self, force_g: float, angle: float, rate: float) -> float:
        """Correct the compression by a reading; returns what the model did not expect, mm."""
        seen_at = angle - rate * (DELAY_S + PERIOD_S / 2.0)
        surface = self._drift + self._run_out_rate(seen_at, rate)
        self._compression += self._shown + surface * PERIOD_S
        surprise = force_g / self.stiffness_g_mm - self._compression
        self._compression += SHARE_SEEN * surprise
        # A ridge that passes slowly in a ramp would weigh more than all of the run.
        if abs(rate) > TURNING_RAD_S and rate == self._last_rate:
            share = SHARE_LEARNED * surprise / rate
            self.sine = _within(self.sine + share * math.cos(seen_at), MOST_RUN_OUT_MM)
            self.cosine = _within(self.cosine - share * math.sin(seen_at), MOST_RUN_OUT_MM)
        return surprise

    def _run_out_rate(self, angle: float, rate: float) -> float:
        if abs(rate) < TURNING_RAD_S:
            return 0.0
        return rate * (self.sine * math.cos(angle) - self.cosine * math.sin(angle))
