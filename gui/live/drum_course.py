"""The last minutes of force and speed on the time axis of the samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gui.live.sample_history import CAPACITY_S, SampleHistory, TimeWindow
from rigctl.engine.live_file import LiveReader, Ring
from rigctl.values import SAMPLE_RATE_HZ

COLUMNS = ("force_g", "force_set_g", "speed_mm_s", "speed_set_mm_s")
SHOWN_POINTS = 1500
"""Longer courses are drawn as the lowest and highest of groups of points."""
_ROWS_A_S = 100
_NEW_ROWS, _ALL_ROWS = 256, 1 << 13

Floats = NDArray[np.float64]


class DrumCourse:
    """Force and speed with their set-points, each row at the position of its engine time."""

    def __init__(self) -> None:
        names = ("position", *COLUMNS)
        self._rings = {name: Ring(CAPACITY_S * _ROWS_A_S, np.dtype(np.float64)) for name in names}
        self._head = 0

    def clear(self) -> None:
        """Remove all rows."""
        self._head = 0
        for ring in self._rings.values():
            ring.clear()

    @property
    def newest(self) -> float:
        """Position of the newest row, minus infinity without one."""
        ring = self._rings["position"]
        return float(ring.between(ring.end - 1, ring.end)[0]) if ring.end else -np.inf

    def pull(self, live: LiveReader, history: SampleHistory) -> None:
        """Append what the engine wrote since the last pull."""
        window = live.drum(_NEW_ROWS)
        if window.first > self._head:
            window = live.drum(_ALL_ROWS)
        first = max(0, self._head - window.first)
        self._head = window.first + len(window)
        columns = {name: getattr(window, name)[first:] for name in COLUMNS}
        self.append(history.position_at(window.time_s[first:]), columns)

    def append(self, position: Floats, columns: dict[str, Floats]) -> None:
        """Append rows, (n,) each, at ascending positions."""
        if len(position):
            self._rings["position"].append(np.maximum(position, self.newest))
            for name, column in columns.items():
                self._rings[name].append(column)

    def within(self, window: TimeWindow) -> tuple[Floats, dict[str, Floats]]:
        """Return times in s on the window's axis, and the columns; one row beyond each end."""
        ring = self._rings["position"]
        bounds = ring.count_below(np.array([window.left, window.right + 1]))
        first, end = max(ring.first, int(bounds[0]) - 1), min(ring.end, int(bounds[1]) + 1)
        time_s = (ring.between(first, end) - window.origin) / SAMPLE_RATE_HZ
        return time_s, {name: self._rings[name].between(first, end) for name in COLUMNS}

    def travelled_mm(self, position: int, n_samples: int) -> float:
        """Return the texture that passed in the samples up to a position, 0 where unknown."""
        _, columns = self.within(TimeWindow(position, n_samples, position))
        speed_mm_s = columns["speed_mm_s"]
        seconds = n_samples / SAMPLE_RATE_HZ
        return float(np.abs(speed_mm_s).mean() * seconds) if len(speed_mm_s) else 0.0

    def at(self, position: float) -> dict[str, float] | None:
        """Return the values that held at a position, None before the first row."""
        ring = self._rings["position"]
        row = int(ring.count_below(np.array([position + 1]))[0]) - 1
        if row < ring.first or row >= ring.end:
            return None
        return {name: float(self._rings[name].between(row, row + 1)[0]) for name in COLUMNS}

    def held_at(self, positions: NDArray[np.int64]) -> dict[str, Floats]:
        """Return the values that held at ascending positions, (n,) each; NaN before the first."""
        ring = self._rings["position"]
        rows = ring.count_below(positions + 1) - 1
        is_known = rows >= ring.first
        return {
            name: np.where(is_known, self._rings[name].take(np.maximum(rows, 0)), np.nan)
            for name in COLUMNS
        }


def thin_out(time_s: Floats, values: Floats, most: int = SHOWN_POINTS) -> tuple[Floats, Floats]:
    """Return at most about ``most`` points: the lowest and highest of equal groups of (n,) ones."""
    if len(values) <= most:
        return time_s, values
    starts = np.arange(0, len(values), -(-2 * len(values) // most))
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    return np.repeat(time_s[starts], 2), np.column_stack((low, high)).ravel()
