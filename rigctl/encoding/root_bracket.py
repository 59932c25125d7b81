"""The search for one C: a rate that rises with it, in jumps, is brought to its target."""

from __future__ import annotations

from enum import IntEnum, StrEnum

HIGHEST_C = 5.0
NARROWEST = 1e-6
PUSH, RIM = 1.02, 0.02
STEEPEST = 5.0
"""How far a slope that was seen is believed: so many times the line through zero, or its part."""


class SearchStatus(IntEnum):
    """How the search for one C ended."""

    REFERENCE = 0  # the reference force itself: C is 1
    CONVERGED = 1  # the rate is within the tolerance
    CAPPED = 2  # even the highest C leaves the rate too low; C is that
    DISCONTINUITY = 3  # the rate jumps over the target; C is the nearer side


class Method(StrEnum):
    """How the next C is chosen inside the bracket."""

    REGULA_FALSI = "regula-falsi"
    BISECTION = "bisection"


class Bracket:
    """One taxel's search: the rate rises with C from 0 at C = 0, in jumps.

    Until a rate was seen on either side of the target, the next guess follows the slope, twice as
    far each time. Then regula falsi with the Illinois rule: an end that stays twice has its
    distance halved, so that the other end moves too. ``slope``: what is known of it before, Hz for
    a C of 1; else the rate is taken to be proportional to C.
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
        # C and distance of the rate at either end; None where nothing was seen.
        self._low: tuple[float, float] | None = None
        self._high: tuple[float, float] | None = None
        self._last, self._last_side = (0.0, -target), 0
        self._push = PUSH
        self.guess = HIGHEST_C / 2 if self._bisects else min(max(start, 0.0), HIGHEST_C)

    def learn(self, rate: float, tolerance_hz: float) -> bool:
        """Take in the rate at the guess and make the next one. True where it was the best yet."""
        self.evaluations += 1
        distance = rate - self._target
        best = self.evaluations == 1 or abs(distance) < abs(self.best_rate - self._target)
        if abs(distance) < tolerance_hz:
            self.status = SearchStatus.CONVERGED
        elif distance < 0 and self.guess >= HIGHEST_C:
            self.status, best = SearchStatus.CAPPED, True
        if best:
            self.best_c, self.best_rate = self.guess, rate
        self._narrow(distance)
        return best

    def give_up(self) -> None:
        """Call a search that is still open a jump over the target."""
        if self.status is None:
            self.status = SearchStatus.DISCONTINUITY

    @property
    def foreseen(self) -> float:
        """C at which the target would be met if the rate followed its slope from the best C on."""
        miss = self.best_rate - self._target
        ahead = self.best_c - miss / self.slope if self.slope > 0 else self.best_c
        return min(max(ahead, 0.0), HIGHEST_C)

    def _narrow(self, distance: float) -> None:
        side, here = (-1 if distance < 0 else 1), (self.guess, distance)
        stays = side == self._last_side
        self._see(here)
        if side < 0:
            self._low = here
            self._high = _halved(self._high) if stays else self._high
        else:
            self._high = here
            self._low = _halved(self._low) if stays else self._low
        self._push = 2 * self._push if stays else PUSH
        self._last, self._last_side = here, side
        self.guess = self._next(here)
        low, high = self._ends()
        if self.status is None and high - low < NARROWEST:
            self.status = SearchStatus.DISCONTINUITY

    def _ends(self) -> tuple[float, float]:
        low = self._low[0] if self._low else 0.0
        return low, self._high[0] if self._high else HIGHEST_C

    def _see(self, here: tuple[float, float]) -> None:
        """Learn the slope: through zero at first, then through the last two rates."""
        c, distance = here
        through_zero = (distance + self._target) / c if c > 0 else 0.0
        if self._last_side and c != self._last[0]:
            seen = (distance - self._last[1]) / (c - self._last[0])
            self.slope = min(max(seen, through_zero / STEEPEST), through_zero * STEEPEST)
        elif self.slope <= 0:
            self.slope = through_zero

    def _next(self, here: tuple[float, float]) -> float:
        low, high = self._ends()
        if self._bisects:
            return HIGHEST_C if low > HIGHEST_C - 2 * NARROWEST else (low + high) / 2
        if self._low and self._high:
            below, above = self._low[1], self._high[1]
            share = below / (below - above) if above > below else 0.5
            # A guess on the rim would learn nothing.
            return low + (high - low) * min(max(share, RIM), 1 - RIM)
        c, distance = here
        step = self._push * abs(distance) / self.slope if self.slope > 0 else HIGHEST_C
        return min(HIGHEST_C, c + step) if distance < 0 else max(c - step, RIM * c)


def _halved(end: tuple[float, float] | None) -> tuple[float, float] | None:
    return None if end is None else (end[0], end[1] / 2)
