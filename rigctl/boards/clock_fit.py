"""A board's clock against the loop's clock: a line through pairs of readings.

A board's resonator is off by up to half a percent. Each poll, and each block, pairs a board
time with the loop time at which it arrived. Arrivals are late at random and never early, so the
fit drops the few points far from the line and repeats, until they are the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

WINDOW_POINTS = 3000
MIN_NEW_POINTS = 20
"""Least number of new readings before a fit, which needs a tenth of all besides."""
RECENT_S = 5.0
"""Window of the earliest arrivals, in which 100 ppm of clock error amount to 0.5 ms."""
_PASSES = 4
_INLIER_SIGMAS = 2.5
_MAD_TO_SIGMA = 1.4826
_MIN_SIGMA_S = 1e-6


class ClockEstimate(NamedTuple):
    """Clock error with its standard error, from readings that span ``span_s`` of loop time.

    ``ppm``: positive where the board's clock runs faster than the loop's.
    """

    ppm: float
    error_ppm: float
    span_s: float


class ArrivalLine(NamedTuple):
    """Line of board time against the loop time of the earliest arrivals.

    ``spread_s``: delay of the median arrival after the earliest ones.
    """

    board_from_s: float
    loop_from_s: float
    rate: float
    spread_s: float

    def loop_s(self, board_s: float) -> float:
        """Return the earliest loop time at which a reading of ``board_s`` arrives."""
        return self.loop_from_s + (board_s - self.board_from_s) / self.rate

    def board_s(self, loop_s: float) -> float:
        """Return the latest board time whose reading can arrive at ``loop_s``."""
        return self.board_from_s + (loop_s - self.loop_from_s) * self.rate


class ClockFit:
    """The newest readings of one board's clock, and its error estimated from them."""

    def __init__(self) -> None:
        self._readings = np.zeros((WINDOW_POINTS, 2))
        self._count = 0
        self._fitted = 0
        self._estimate: ClockEstimate | None = None

    def add(self, board_s: float, loop_s: float) -> None:
        """Add a board time with the loop time of its arrival; both in seconds, ascending."""
        self._readings[self._count % len(self._readings)] = (board_s, loop_s)
        self._count += 1

    def reset(self) -> None:
        """Drop all readings: the board rebooted."""
        self._count = 0
        self._fitted = 0
        self._estimate = None

    @property
    def estimate(self) -> ClockEstimate | None:
        """The clock error from all readings, None while there are too few."""
        n_readings = min(self._count, len(self._readings))
        if self._count - self._fitted >= max(MIN_NEW_POINTS, n_readings // 10):
            self._fitted = self._count
            readings = self._readings[:n_readings]
            self._estimate = fit_clock(readings[:, 0], readings[:, 1])
        return self._estimate

    @property
    def ppm(self) -> float | None:
        """Clock error of the board, positive where it runs fast; None while it is unknown."""
        return self.estimate.ppm if self.estimate else None

    @property
    def earliest_arrivals(self) -> ArrivalLine | None:
        """The line below the readings of the last seconds, None while the clock is unknown."""
        estimate = self.estimate
        if estimate is None:
            return None
        board_s, loop_s = self._readings[(self._count - 1) % len(self._readings)]
        board, loop = self._readings[: min(self._count, len(self._readings))].T
        recent = loop > loop_s - RECENT_S
        rate = 1.0 + estimate.ppm * 1e-6
        delay_s = (loop[recent] - loop_s) - (board[recent] - board_s) / rate
        first_s = float(delay_s.min())
        spread_s = float(np.median(delay_s)) - first_s
        return ArrivalLine(float(board_s), float(loop_s) + first_s, rate, spread_s)


class _Line(NamedTuple):
    slope: float
    sigma: float
    spread: float


def fit_clock(board_s: NDArray[np.float64], loop_s: NDArray[np.float64]) -> ClockEstimate | None:
    """Fit board time against loop time, both float64 (n,); None where they span no time."""
    loop = loop_s - loop_s.mean()
    gained = board_s - board_s.mean() - loop
    inliers = np.ones(len(loop), dtype=bool)
    for _ in range(_PASSES):
        line, residual = _fit_line(loop, gained, inliers)
        before, inliers = inliers, np.abs(residual) <= _INLIER_SIGMAS * line.sigma
        if inliers.sum() < 3 or line.spread <= 0:
            return None
        if np.array_equal(inliers, before):
            break
    error = line.sigma / (line.spread * np.sqrt(inliers.sum()))
    return ClockEstimate(line.slope * 1e6, float(error * 1e6), float(np.ptp(loop_s)))


def _fit_line(
    x: NDArray[np.float64], y: NDArray[np.float64], inliers: NDArray[np.bool_]
) -> tuple[_Line, NDArray[np.float64]]:
    """Return the line through the inliers with their robust spread, and all residuals."""
    fit_x, fit_y = x[inliers], y[inliers]
    mean_x, mean_y, spread = fit_x.mean(), fit_y.mean(), float(fit_x.std())
    slope = float((fit_x - mean_x) @ (fit_y - mean_y)) / max(len(fit_x) * spread**2, 1e-12)
    residual = y - mean_y - slope * (x - mean_x)
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(residual - np.median(residual))))
    return _Line(slope, max(sigma, _MIN_SIGMA_S), spread), residual
