"""Search one C: bring a rate that rises with C, in jumps, to its target."""

from __future__ import annotations

from enum import IntEnum, StrEnum

MAX_C = 5.0
MIN_BRACKET_WIDTH = 1e-6
OVERSHOOT, EDGE_MARGIN = 1.02, 0.02
MAX_SLOPE_RATIO = 5.0
"""Limit of a measured slope: this many times the line through zero, or this part of it."""


class SearchStatus(IntEnum):
    """How the search for one C ended."""

    REFERENCE = 0  # the reference force itself: C is 1
    CONVERGED = 1  # the rate is within the tolerance
    CAPPED = 2  # even the highest C leaves the rate too low; C is that
    DISCONTINUITY = 3  # the rate jumps over the target; C is the nearer side


class Method(StrEnum):
    """How to choose the next C inside the bracket."""

    REGULA_FALSI = "regula-falsi"
    BISECTION = "bisection"


class Bracket:
    """The search of one taxel: the rate rises with C from 0 at C = 0, in jumps.

    Until there is a rate on either side of the target, the next guess follows the slope, twice as
    far each time. Then regula falsi with the Illinois rule: it halves the error of an end that does
    not move twice in a row, so that the other end moves too. ``slope``: an estimate in Hz for a C
    of 1; without one the rate is taken to be proportional to C.
    """

    def __init__(
        self, target: float, start: float, method: Method, slope: float | None = None
    ) -> None:
        self.status: SearchStatus | None = None
        self.evaluations = 0
        self.best_c, self.best_rate = 0.0, 0.0
        self.slope = slope or 0.0
        self._target = target
        self._bisects = method is Method.BISECTION
        # C and error of the rate at either end; None before the first rate on that side.
        self._low: tuple[float, float] | None = None
        self._high: tuple[float, float] | None = None
        self._last, self._last_side = (0.0, -target), 0
        self._step_factor = OVERSHOOT
        self.guess = MAX_C / 2 if self._bisects else min(max(start, 0.0), MAX_C)

    def update(self, rate: float, tolerance_hz: float) -> bool:
        """Take the rate at the guess and choose the next guess; return True for the best so far."""
        self.evaluations += 1
        error = rate - self._target
        best = self.evaluations == 1 or abs(error) < abs(self.best_rate - self._target)
        if abs(error) < tolerance_hz:
            self.status = SearchStatus.CONVERGED
        elif error < 0 and self.guess >= MAX_C:
            self.status, best = SearchStatus.CAPPED, True
        if best:
            self.best_c, self.best_rate = self.guess, rate
        self._narrow(error)
        return best

    def give_up(self) -> None:
        """Mark a search that is still open as a jump over the target."""
        if self.status is None:
            self.status = SearchStatus.DISCONTINUITY

    @property
    def predicted_c(self) -> float:
        """C at which the rate would meet the target if it followed its slope from the best C on."""
        error = self.best_rate - self._target
        predicted = self.best_c - error / self.slope if self.slope > 0 else self.best_c
        return min(max(predicted, 0.0), MAX_C)

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
        if self.status is None and high - low < MIN_BRACKET_WIDTH:
            self.status = SearchStatus.DISCONTINUITY

    def _ends(self) -> tuple[float, float]:
        low = self._low[0] if self._low else 0.0
        return low, self._high[0] if self._high else MAX_C

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
            return MAX_C if low > MAX_C - 2 * MIN_BRACKET_WIDTH else (low + high) / 2
        if self._low and self._high:
            below, above = self._low[1], self._high[1]
            share = below / (below - above) if above > below else 0.5
            # A guess at the very edge would give no information.
            return low + (high - low) * min(max(share, EDGE_MARGIN), 1 - EDGE_MARGIN)
        c, error = point
        step = self._step_factor * abs(error) / self.slope if self.slope > 0 else MAX_C
        return min(MAX_C, c + step) if error < 0 else max(c - step, EDGE_MARGIN * c)


def _halve_error(end: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if end is None else (end[0], end[1] / 2)
