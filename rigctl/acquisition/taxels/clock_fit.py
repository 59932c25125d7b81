"""How fast a board's clock runs against the loop's: a line through pairs of readings.

A board's resonator is off by up to half a percent. Each poll, and each block, pairs a board
time with the loop time at which it arrived. Arrivals come late by chance, never early, so a few
points far from the line are dropped and the line is drawn again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WINDOW_POINTS = 3000
FEWEST_POINTS = 20
"""To begin with, and before the line is drawn anew."""
RECENT_S = 5.0
"""What arrived earliest is looked for in so long: a clock error of 100 ppm is 0.5 ms of it."""
_PASSES = 4
_KEEP_SIGMAS = 2.5
_MAD_TO_SIGMA = 1.4826
_LEAST_SIGMA_S = 1e-6


class ClockEstimate(NamedTuple):
    """``ppm``: how much faster than the loop's the board's clock runs; its standard error;
    the loop time that the readings span."""

    ppm: float
    error_ppm: float
    span_s: float


class ArrivalLine(NamedTuple):
    """Board time against the loop time of the earliest arrivals; ``spread_s``: their median is
    so much later."""

    board_from_s: float
    loop_from_s: float
    rate: float
    spread_s: float

    def loop_s(self, board_s: float) -> float:
        """When what the board said at ``board_s`` arrives at the earliest."""
        return self.loop_from_s + (board_s - self.board_from_s) / self.rate

    def board_s(self, loop_s: float) -> float:
        """What the board said at the latest where it arrives at ``loop_s``."""
        return self.board_from_s + (loop_s - self.loop_from_s) * self.rate


class ClockFit:
    """The newest readings of one board's clock, and the line through them."""

    def __init__(self, window_points: int = WINDOW_POINTS) -> None:
        self._readings = np.zeros((window_points, 2))
        self._count = 0
        self._fitted = 0
        self._estimate: ClockEstimate | None = None

    def add(self, board_s: float, loop_s: float) -> None:
        """Pair a board time with the loop time of its arrival; both in seconds, ascending."""
        self._readings[self._count % len(self._readings)] = (board_s, loop_s)
        self._count += 1

    def restart(self) -> None:
        """Forget everything: the board rebooted."""
        self._count = 0
        self._fitted = 0
        self._estimate = None

    @property
    def estimate(self) -> ClockEstimate | None:
        """The line through the readings, None while there are too few."""
        if self._count - self._fitted >= FEWEST_POINTS:
            self._fitted = self._count
            kept = self._readings[: min(self._count, len(self._readings))]
            self._estimate = fit_clock(kept[:, 0], kept[:, 1])
        return self._estimate

    @property
    def earliest(self) -> ArrivalLine | None:
        """The line below the readings of the last seconds, None while the clock is unknown."""
        estimate = self.estimate
        if estimate is None:
            return None
        board_s, loop_s = self._readings[(self._count - 1) % len(self._readings)]
        board, loop = self._readings[: min(self._count, len(self._readings))].T
        recent = loop > loop_s - RECENT_S
        rate = 1.0 + estimate.ppm * 1e-6
        late = (loop[recent] - loop_s) - (board[recent] - board_s) / rate
        first_s = float(late.min())
        spread_s = float(np.median(late)) - first_s
        return ArrivalLine(float(board_s), float(loop_s) + first_s, rate, spread_s)


class _Line(NamedTuple):
    slope: float
    sigma: float
    spread: float


def fit_clock(board_s: NDArray[np.float64], loop_s: NDArray[np.float64]) -> ClockEstimate | None:
    """Fit board time against loop time, both float64 (n,); None where they span no time."""
    loop = loop_s - loop_s.mean()
    gained = board_s - board_s.mean() - loop
    kept = np.ones(len(loop), dtype=bool)
    for _ in range(_PASSES):
        line, residual = _line(loop, gained, kept)
        kept = np.abs(residual) <= _KEEP_SIGMAS * line.sigma
        if kept.sum() < 3 or line.spread <= 0:
            return None
    error = line.sigma / (line.spread * np.sqrt(kept.sum()))
    return ClockEstimate(line.slope * 1e6, float(error * 1e6), float(np.ptp(loop_s)))


def _line(
    x: NDArray[np.float64], y: NDArray[np.float64], kept: NDArray[np.bool_]
) -> tuple[_Line, NDArray[np.float64]]:
    """The line through the kept points with their robust spread; residuals of all points."""
    near_x, near_y = x[kept], y[kept]
    centre_x, centre_y, spread = near_x.mean(), near_y.mean(), float(near_x.std())
    slope = float((near_x - centre_x) @ (near_y - centre_y)) / max(len(near_x) * spread**2, 1e-12)
    residual = y - centre_y - slope * (x - centre_x)
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(residual - np.median(residual))))
    return _Line(slope, max(sigma, _LEAST_SIGMA_S), spread), residual
