"""The compiled loop of :class:`rigctl.encoder.force_gain.ForceGain`."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from rigctl.encoder.reading import HIGHEST


def _scale(readings: Any, gains: Any, base: Any, shift: Any, unit_bits: Any, out: Any) -> None:
    """Multiply what each reading is above its base, by the gain at the sum of a sample's.

    The gain is interpolated between two knots.
    """
    for t in range(readings.shape[0]):
        total = np.int64(0)
        for i in range(readings.shape[1]):
            total += max(readings[t, i] - base[i], 0)
        knot = min(total >> shift, len(gains) - 2)
        into = min(total - (knot << shift), np.int64(1) << shift)
        gain = gains[knot] + (((gains[knot + 1] - gains[knot]) * into) >> shift)
        for i in range(readings.shape[1]):
            above = np.int64(readings[t, i]) - base[i]
            scaled = base[i] + ((above * gain) >> unit_bits)
            out[t, i] = min(scaled, HIGHEST) if above > 0 else readings[t, i]


scale = numba.njit(cache=True, nogil=True)(_scale)
