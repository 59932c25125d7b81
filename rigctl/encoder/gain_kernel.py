"""The compiled loop of :class:`rigctl.encoder.force_gain.ForceGain`."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from rigctl.encoder.force_gain import KNOTS, UNIT_BITS
from rigctl.encoder.reading import HIGHEST


def _scale(readings: Any, gains: Any, layer: Any, shift: Any, out: Any) -> None:
    """Multiply each reading by the gain at its sample's sum, interpolated between two knots."""
    now = np.empty(gains.shape[0], np.int64)
    for t in range(readings.shape[0]):
        total = np.int64(0)
        for i in range(readings.shape[1]):
            total += readings[t, i]
        knot = min(total >> shift, KNOTS - 1)
        into = min(total - (knot << shift), np.int64(1) << shift)
        for k in range(gains.shape[0]):
            low, high = gains[k, knot], gains[k, knot + 1]
            now[k] = low + (((high - low) * into) >> shift)
        for i in range(readings.shape[1]):
            out[t, i] = min((readings[t, i] * now[layer[i]]) >> UNIT_BITS, HIGHEST)


scale = numba.njit(cache=True, nogil=True)(_scale)
