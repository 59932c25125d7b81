"""When a slide over the plate begins and ends, by the tracker; whether the sensor touches it."""

from __future__ import annotations

from collections import deque
from enum import Enum
from math import inf

import numpy as np
from numpy.typing import NDArray

from rigctl.finger.values import MARKS_MM
from rigctl.values import SAMPLE_RATE_HZ

SLOPE_S = 0.06
"""Span of the positions that give the present velocity."""
BACKWARDS_MM = 5.0
STILL_MM, STILL_S = 1.0, 1.0
LIFTED_MM = 25.0
"""Height of the tracker above the plate's frame at which the finger cannot touch any more."""
BESIDE_MM = 25.0
LOST_S = 1.0


class SlideState(Enum):
    """Place of the finger in the course of a slide."""

    AWAY = "away"
    READY = "ready"
    INSIDE = "inside"


class SlideDetector:
    """Follows one slide after the other. Times are loop time.

    ``broken``: why the last scan broke off, empty if it reached the second mark.
    """

    def __init__(self) -> None:
        self.state = SlideState.AWAY
        self.broken = ""
        self._recent: deque[tuple[float, float]] = deque()
        self._farthest_mm = 0.0
        self._moved_at_s = 0.0
        self._moved_mm = 0.0
        self._last_s = 0.0

    def add(
        self, now_s: float, at_s: float, along_mm: float, across_mm: float, height_mm: float
    ) -> SlideState:
        """Add a position of plate coordinates that held at ``at_s``; return the new state."""
        self._last_s = now_s
        self._recent.append((at_s, along_mm))
        while at_s - self._recent[0][0] > SLOPE_S:
            self._recent.popleft()
        present_mm = along_mm + self._velocity_mm_s() * (now_s - at_s)
        on_plate = height_mm < LIFTED_MM and abs(across_mm) < BESIDE_MM
        if self.state is SlideState.INSIDE:
            self._follow(now_s, along_mm, present_mm, on_plate)
        elif self.state is SlideState.READY and present_mm >= MARKS_MM[0] and on_plate:
            self._begin(now_s, along_mm)
        else:
            ready = present_mm < MARKS_MM[0]
            self.state = SlideState.READY if ready else SlideState.AWAY
        return self.state

    def check_silence(self, now_s: float) -> SlideState:
        """Break a scan off that has had no position for long; return the new state."""
        if self.state is SlideState.INSIDE and now_s - self._last_s > LOST_S:
            self._break(f"no position of the finger for {LOST_S:g} s")
        return self.state

    def _begin(self, now_s: float, along_mm: float) -> None:
        self.state, self.broken = SlideState.INSIDE, ""
        self._farthest_mm = self._moved_mm = along_mm
        self._moved_at_s = now_s

    def _follow(self, now_s: float, along_mm: float, present_mm: float, on_plate: bool) -> None:
        self._farthest_mm = max(self._farthest_mm, along_mm)
        if abs(along_mm - self._moved_mm) > STILL_MM:
            self._moved_mm, self._moved_at_s = along_mm, now_s
        if present_mm >= MARKS_MM[1]:
            self.state = SlideState.AWAY
        elif along_mm < self._farthest_mm - BACKWARDS_MM:
            self._break("the finger moved backwards")
        elif now_s - self._moved_at_s > STILL_S:
            self._break(f"the finger stood still for {STILL_S:g} s")
        elif not on_plate:
            self._break(f"the finger left the plate after {along_mm - MARKS_MM[0]:.0f} mm")

    def _break(self, reason: str) -> None:
        self.state, self.broken = SlideState.AWAY, reason

    def _velocity_mm_s(self) -> float:
        """Return the mean velocity of the recent positions, 0 for fewer than two."""
        (first_s, first_mm), (last_s, last_mm) = self._recent[0], self._recent[-1]
        return (last_mm - first_mm) / (last_s - first_s) if last_s > first_s else 0.0


CONTACT_COUNTS = 20.0
"""Mean rise over rest at which the sensor touches; the converter's noise is below 1 count, and what
a skin keeps of a press fades from about 12."""
RIDGE_GAP_SAMPLES = 50
"""Longest time for which a light finger is felt by no taxel, because a stiff skin rests on ridges
that are all between the taxels."""
KEPT_S = 120
"""Rest is taken from this time: it drifts with the sensor's warmth and wear."""
REST_PERCENTILE = 5
"""Of the lowest level of each second: a bad reading must not become rest."""


class ContactMeter:
    """Compares the mean reading of all taxels with rest, the low levels of the last two minutes.

    The finger is in the air between two slides, so a twentieth of the time is rest. ``pressed``: in
    which of the samples that were added last the taxels are pressed, bool (n,).
    """

    def __init__(self) -> None:
        self.touches = False
        self.pressed: NDArray[np.bool_] = np.zeros(0, np.bool_)
        self._since_pressed = RIDGE_GAP_SAMPLES + 1
        self._lowest: deque[float] = deque(maxlen=KEPT_S)
        self._second_lowest, self._second_samples = inf, 0
        self._rest = inf

    def add(self, readings: NDArray[np.uint16]) -> None:
        """Add samples, uint16 (n, 9), in the order in which they were taken."""
        if not len(readings):
            return
        self._second_lowest = min(self._second_lowest, float(readings.mean()))
        self._second_samples += len(readings)
        levels = [*self._lowest, self._second_lowest]
        if self._second_samples >= SAMPLE_RATE_HZ:
            self._lowest.append(self._second_lowest)
            self._second_lowest, self._second_samples = inf, 0
        self._rest = sorted(levels)[REST_PERCENTILE * (len(levels) - 1) // 100]
        self.pressed = readings.mean(axis=1) > self._rest + CONTACT_COUNTS
        last = np.flatnonzero(self.pressed[::-1])
        self._since_pressed = int(last[0]) if len(last) else self._since_pressed + len(readings)
        self.touches = self._since_pressed <= RIDGE_GAP_SAMPLES


def contact_share(pressed: NDArray[np.bool_]) -> float:
    """Return the share of samples, bool (n,), in which the sensor touches; 0 where there are none.

    A gap counts as contact if it lasts no longer than ridges may hide the finger from the taxels.
    """
    ends = np.concatenate([[-1], np.flatnonzero(pressed), [len(pressed)]])
    gaps = np.diff(ends) - 1
    return float(1.0 - gaps[gaps > RIDGE_GAP_SAMPLES].sum() / max(len(pressed), 1))
