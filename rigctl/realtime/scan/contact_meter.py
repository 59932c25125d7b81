"""Whether the sensor touches the plate, from its readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CONTACT_COUNTS = 30.0
"""Mean rise over rest at which the sensor touches; the converter's noise is below 1 count."""
SMOOTHED_SAMPLES = 50


class ContactMeter:
    """Compares the mean reading of all taxels with its lowest level so far, which is rest."""

    def __init__(self) -> None:
        self.touches = False
        self._rest = np.inf

    def add(self, readings: NDArray[np.uint16]) -> None:
        """Add samples, uint16 (n, 9), in the order in which they were taken."""
        if not len(readings):
            return
        means = readings.mean(axis=1)
        smooth = means if len(means) < SMOOTHED_SAMPLES else _moving_mean(means)
        self._rest = min(self._rest, float(np.min(smooth)))
        self.touches = bool(self.touched(readings[-1:])[0])

    def touched(self, readings: NDArray[np.uint16]) -> NDArray[np.bool_]:
        """Return in which samples the sensor touches, bool (n,)."""
        above: NDArray[np.bool_] = readings.mean(axis=1) > self._rest + CONTACT_COUNTS
        return above


def _moving_mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.convolve(values, np.full(SMOOTHED_SAMPLES, 1 / SMOOTHED_SAMPLES), "valid")
