"""Whether the sensor touches the plate, from its readings."""

from __future__ import annotations

from collections import deque
from math import inf

import numpy as np
from numpy.typing import NDArray

from rigctl.values import SAMPLE_RATE_HZ

CONTACT_COUNTS = 30.0
"""Mean rise over rest at which the sensor touches; the converter's noise is below 1 count."""
KEPT_S = 120
"""Rest is taken from this time: it drifts with the sensor's warmth and wear."""
REST_PERCENTILE = 5.0
"""Of the lowest level of each second: a bad reading must not become rest."""


class ContactMeter:
    """Compares the mean reading of all taxels with rest, the low levels of the last two minutes.

    The finger is in the air between two slides, so a twentieth of the time is rest.
    """

    def __init__(self) -> None:
        self.touches = False
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
        self._rest = float(np.percentile(levels, REST_PERCENTILE, method="lower"))
        self.touches = bool(self.touched(readings[-1:])[0])

    def touched(self, readings: NDArray[np.uint16]) -> NDArray[np.bool_]:
        """Return in which samples the sensor touches, bool (n,)."""
        above: NDArray[np.bool_] = readings.mean(axis=1) > self._rest + CONTACT_COUNTS
        return above
