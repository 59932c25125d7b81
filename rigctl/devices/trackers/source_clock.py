"""A tracker's own time stamps as loop time: what jitters is the arrival, not the measurement."""

from __future__ import annotations

from rigctl.devices.clock_fit import ClockFit

TRUSTED_PPM = 200.0
"""Until the rate of the source's clock is known this well, it counts as exact."""
RESTART_S = 1.0
"""A source whose time leaps by more than this has begun its clock again."""


class SourceClock:
    """Maps ascending source times to loop times.

    No message arrives early, so the earliest arrivals tell the offset of the clocks; the known
    ``latency_s`` is subtracted. ``restarts`` counts how often the source's time began anew. Loop
    times ascend, also where an earlier arrival shows that those before were told too late.
    """

    def __init__(self, latency_s: float) -> None:
        self.restarts = 0
        self._latency_s = latency_s
        self._fit = ClockFit()
        self._last: tuple[float, float] | None = None
        self._earliest_s = float("inf")
        self._told_s = float("-inf")

    def loop_s(self, source_s: float, arrived_s: float) -> float | None:
        """Return the loop time of a measurement; None where its time does not ascend."""
        if self._last is not None:
            passed_s = source_s - self._last[0]
            if not -RESTART_S < passed_s < arrived_s - self._last[1] + RESTART_S:
                self._restart()
            elif passed_s <= 0.0:
                return None
        self._last = (source_s, arrived_s)
        at_s = self._fitted_s(source_s, arrived_s)
        if at_s <= self._told_s:
            return None
        self._told_s = at_s
        return at_s

    def _fitted_s(self, source_s: float, arrived_s: float) -> float:
        self._fit.add(source_s, arrived_s)
        self._earliest_s = min(self._earliest_s, arrived_s - source_s)
        estimate = self._fit.estimate
        line = self._fit.earliest_arrivals
        if estimate is None or line is None or estimate.error_ppm > TRUSTED_PPM:
            return source_s + self._earliest_s - self._latency_s
        return min(line.loop_s(source_s), arrived_s) - self._latency_s

    def _restart(self) -> None:
        self.restarts += 1
        self._fit.reset()
        self._earliest_s = float("inf")
