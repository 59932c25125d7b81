"""Search one C: bring a rate that rises with C, in jumps, to its target.

The paper limits only coefficients that do not converge, to 5 (Materials and Methods, Force
Invariance Module). So a search that is too low at 5 goes on beyond; a C above 5 stands where the
rate reaches its target there, and is otherwise 5.
"""

from __future__ import annotations

from enum import IntEnum, StrEnum

LIMIT_C = 5.0
"""C of an entry that would be higher, but does not converge (the paper's value)."""
HIGHEST_C = 1024.0
"""Highest C to try: one count of a range of 10 bits then drives a neuron like full scale."""
MIN_BRACKET_WIDTH = 1e-6
SILENT_STEP = 8.0
"""Factor on a C above 5 at which the neuron is still silent."""
OVERSHOOT, EDGE_MARGIN = 1.02, 0.02
MAX_SLOPE_RATIO = 5.0
"""Limit of a measured slope: this many times the line through zero, or this part of it."""


class SearchStatus(IntEnum):
    """How the search for one C ended."""

    ABSENT = -1  # no trial, or none at the reference force: there is no C
    REFERENCE = 0  # the reference force itself: C is 1
    CONVERGED = 1  # the rate is within the tolerance
    CAPPED = 2  # no C above 5 brings the rate to the target either; C is 5
    DISCONTINUITY = 3  # the rate jumps over the target below 5; C is the nearer side


class Method(StrEnum):
    """How to choose the next C inside the bracket."""

    REGULA_FALSI = "regula-falsi"
    BISECTION = "bisection"


class Bracket:
    """The search of one taxel: the rate rises with C from 0 at C = 0, in jumps.

    Until there is a rate on either side of the target, the next guess follows the slope, twice as
    far each time; it stops at 5 once before it goes on to ``highest``. Then regula falsi with the
    Illinois rule: it halves the error of an end that does not move twice in a row, so that the
    other end moves too. ``slope``: an estimate in Hz for a C of 1; without one the rate is taken to
    be proportional to C.
    """

    def __init__(
        self,
        target: float,
        start: float,
        method: Method,
        slope: float | None = None,
        highest: float = HIGHEST_C,
    ) -> None:
        self.status: SearchStatus | None = None
        self.evaluations = 0
        self.best_c, self.best_rate = 0.0, 0.0
        self.slope = slope or 0.0
        self._target, self._highest = target, highest
        self._bisects = method is Method.BISECTION
        # C and error of the rate at either end; None before the first rate on that side.
        self._low: tuple[float, float] | None = None
        self._high: tuple[float, float] | None = None
        self._last, self._last_side = (0.0, -target), 0
        self._step_factor = OVERSHOOT
        self.guess = LIMIT_C / 2 if self._bisects else min(max(start, 0.0), LIMIT_C)

    def update(self, rate: float, tolerance_hz: float) -> bool:
        """Take the rate at the guess and choose the next guess; return True for the best so far.

        Above 5, only a rate within the tolerance is better than that at 5.
        """
        self.evaluations += 1
        error = rate - self._target
        nearer = self.evaluations == 1 or abs(error) < abs(self.best_rate - self._target)
        best = nearer and self.guess <= LIMIT_C
        if abs(error) < tolerance_hz:
            self.status, best = SearchStatus.CONVERGED, True
        elif error < 0 and self.guess == LIMIT_C:
            best = True
        if best:
            self.best_c, self.best_rate = self.guess, rate
        self._narrow(error)
        return best

    def give_up(self) -> None:
        """Mark a search that is still open as a jump over the target, or as limited to 5."""
        if self.status is None:
            low, _ = self._ends()
            limited = low >= LIMIT_C
            self.status = SearchStatus.CAPPED if limited else SearchStatus.DISCONTINUITY

    @property
    def predicted_c(self) -> float:
        """C at which the rate would meet the target if it followed its slope from the best C on."""
        error = self.best_rate - self._target
        predicted = self.best_c - error / self.slope if self.slope > 0 else self.best_c
        return min(max(predicted, 0.0), LIMIT_C)

    def _narrow(self, error: float) -> None:
        side, point = (-1 if error < 0 else 1), (self.guess, error)
        same_side = side == self._last_side
        self._update_slope(point)
        if side < 0:
            self._low = point
            self._high = _halve_error(self._high) if same_side else self._high
        else:
            self._high = point
            self._low = _halve_error(self._low) if same_side else self._low
        self._step_factor = 2 * self._step_factor if same_side else OVERSHOOT
        self._last, self._last_side = point, side
        self.guess = self._next_guess(point)
        low, high = self._ends()
        if high - low < MIN_BRACKET_WIDTH * max(1.0, low / LIMIT_C):
            self.give_up()

    def _ends(self) -> tuple[float, float]:
        low = self._low[0] if self._low else 0.0
        return low, self._high[0] if self._high else self._highest

    def _update_slope(self, point: tuple[float, float]) -> None:
        """Estimate the slope: through zero at first, then through the last two rates."""
        c, error = point
        through_zero = (error + self._target) / c if c > 0 else 0.0
        if self._last_side and c != self._last[0]:
            measured = (error - self._last[1]) / (c - self._last[0])
            limits = through_zero / MAX_SLOPE_RATIO, through_zero * MAX_SLOPE_RATIO
            self.slope = min(max(measured, limits[0]), limits[1])
        elif self.slope <= 0:
            self.slope = through_zero

    def _next_guess(self, point: tuple[float, float]) -> float:
        low, high = self._ends()
        if self._bisects:
            return (low + high) / 2 if self._high else self._higher(2 * low)
        if self._low and self._high:
            below, above = self._low[1], self._high[1]
            share = below / (below - above) if above > below else 0.5
            # A guess at the very edge would give no information.
            return low + (high - low) * min(max(share, EDGE_MARGIN), 1 - EDGE_MARGIN)
        c, error = point
        if self.slope <= 0:
            return self._higher(max(LIMIT_C, SILENT_STEP * c)) if error < 0 else EDGE_MARGIN * c
        step = self._step_factor * abs(error) / self.slope
        return self._higher(c + step) if error < 0 else max(c - step, EDGE_MARGIN * c)

    def _higher(self, c: float) -> float:
        """Return the next guess above all so far: 5 itself before any beyond."""
        low, high = self._ends()
        return min(c, LIMIT_C if low < LIMIT_C else high)


def _halve_error(end: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if end is None else (end[0], end[1] / 2)
