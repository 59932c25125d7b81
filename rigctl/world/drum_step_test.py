"""The virtual drum's step test: a small lift in a held force, and the gains that it suggests.

The area between the force and its end, over its whole fall, is half the time of lifting plus
everything that delays the force, whatever the shape of the answer.
"""

from __future__ import annotations

from dataclasses import dataclass

PERIOD_S = 0.0125
LIFT_MM_S = 1.0
STEP_SHARE = 0.1
REST_SAMPLES, MEAN_SAMPLES, ANSWER_SAMPLES = 24, 8, 40
LEAST_LIFT, MOST_LIFT = 4, 40
LEAST_STEP_G = 10.0
SHARES_EXPECTED = (0.2, 5.0)
DELAYS_S = (0.01, 0.3)
GAIN_P_TIMES_DELAY = 0.3


@dataclass(frozen=True, slots=True)
class GainProposal:
    """What a step test found, and what follows from it; gains in 1/s."""

    gain_p: float
    gain_i: float
    stiffness_g_per_mm: float
    delay_s: float


class StepTest:
    """One test at a held force of about ``stiffness_g_per_mm``; a call of :meth:`sample` each."""

    def __init__(self, force_g: float, stiffness_g_per_mm: float) -> None:
        wanted = STEP_SHARE * force_g / (stiffness_g_per_mm * LIFT_MM_S * PERIOD_S)
        self._lift = round(max(LEAST_LIFT, min(MOST_LIFT, wanted)))
        self._travel_mm = self._lift * LIFT_MM_S * PERIOD_S
        self._expected_g = self._travel_mm * stiffness_g_per_mm
        self._seen: list[float] = []

    @property
    def finished(self) -> bool:
        """Every sample was taken."""
        return len(self._seen) == REST_SAMPLES + self._lift + ANSWER_SAMPLES

    def sample(self, force_g: float) -> float:
        """One load-cell sample; the speed to ask for now, mm/s."""
        self._seen.append(force_g)
        lifts = REST_SAMPLES <= len(self._seen) < REST_SAMPLES + self._lift
        return -LIFT_MM_S if lifts else 0.0

    def proposal(self) -> GainProposal | None:
        """What follows; None where the answer makes no sense."""
        answer = self._seen[REST_SAMPLES:]
        before_g = sum(self._seen[REST_SAMPLES - MEAN_SAMPLES : REST_SAMPLES]) / MEAN_SAMPLES
        after_g = sum(answer[-MEAN_SAMPLES:]) / MEAN_SAMPLES
        fall_g = before_g - after_g
        low, high = (share * self._expected_g for share in SHARES_EXPECTED)
        if not max(LEAST_STEP_G, low) <= fall_g <= high:
            return None
        area_s = (sum(g - after_g for g in answer) / fall_g + 0.5) * PERIOD_S
        delay_s = area_s - 0.5 * (self._lift - 1) * PERIOD_S
        if not DELAYS_S[0] <= delay_s <= DELAYS_S[1]:
            return None
        return GainProposal(
            GAIN_P_TIMES_DELAY / delay_s,
            PERIOD_S / delay_s**2,
            fall_g / self._travel_mm,
            delay_s,
        )
