"""The latency contract: from the arrival of a velocity to features, prediction and screen.

A velocity arrives when the host knows it and sends it to the board. Then the features of the
windows that it closes come back from the board, the prediction is made, and a window reports that
it has painted it. All times are loop time.
"""

from __future__ import annotations

from collections import deque

import numpy as np

FEATURES, PREDICTION, SCREEN = "features", "prediction", "screen"
KINDS = (FEATURES, PREDICTION, SCREEN)
LIMITS_MS = {FEATURES: ((100.0, 5.0),), SCREEN: ((99.0, 50.0), (99.9, 100.0))}
"""Percentiles and their limits in ms: every velocity to its features, predictions on screen."""
KEPT = 4096


class LatencyLog:
    """The newest latencies in ms, by kind; a session stores all of them."""

    def __init__(self) -> None:
        self._ms: dict[str, deque[float]] = {kind: deque(maxlen=KEPT) for kind in KINDS}

    def add(self, kind: str, ms: float) -> None:
        """Add one latency."""
        self._ms[kind].append(ms)

    def percentile(self, kind: str, percent: float) -> float | None:
        """Return a percentile in ms, None without a latency of this kind."""
        return float(np.percentile(self._ms[kind], percent)) if self._ms[kind] else None

    def percentiles(self, percent: float) -> dict[str, float]:
        """Return a percentile in ms of each kind that was measured."""
        found = {kind: self.percentile(kind, percent) for kind in KINDS}
        return {kind: ms for kind, ms in found.items() if ms is not None}
