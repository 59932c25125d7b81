"""A gain on the SA current for the force that all taxels together show, sample by sample.

C needs the texture's label. This gain needs the sum of all readings of the same instant: the more
they read together, the harder the press, and the less each one's current counts. ``divided`` takes
the sum itself, so that each taxel becomes its share; ``calibrated`` takes the force that the sum
shows on a smooth plate, and the curve of the taxel's layer there.

All of it is integer arithmetic on one sample, without a state: any slicing of the samples, the
analysis and a board get the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.force_matrix import REFERENCE_FORCE_G
from rigctl.encoder.normalisation import Normalisation
from rigctl.encoder.root_bracket import LIMIT_C

UNIT_BITS = 12
UNIT = 1 << UNIT_BITS
"""The gain 1."""
KNOTS = 64
"""Intervals of the sum in which a gain is interpolated."""
HIGHEST_GAIN = round(LIMIT_C * UNIT)
Floats = NDArray[np.float64]
Samples = NDArray[np.uint16]


class ForceScaling(StrEnum):
    """What scales the SA current for the force, without label and load cell."""

    NONE = "none"
    DIVIDED = "divided"
    CALIBRATED = "calibrated"


@dataclass(frozen=True, slots=True)
class ForceGain:
    """Gains on the readings over the sum of all readings.

    ``gains``: for each layer the gain at 0, 1 … :data:`KNOTS` steps of 2 ** ``shift`` of the sum,
    in 1 / :data:`UNIT`; the last one holds for higher sums. ``layer``: that of each taxel.
    """

    shift: int
    gains: tuple[tuple[int, ...], ...]
    layer: tuple[int, ...]

    def apply(self, readings: Samples) -> Samples:
        """Return readings uint16 (n, n_taxels) as they would be at the reference force."""
        # Imported here: the compiler takes long to load, and readers of sessions come this way.
        from rigctl.encoder.gain_kernel import scale

        out = np.empty_like(readings)
        scale(np.ascontiguousarray(readings), *_tables(self), self.shift, out)
        return out


@lru_cache(maxsize=64)
def _tables(gain: ForceGain) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return gains and layers as arrays: to make them takes as long as to scale a batch."""
    return np.array(gain.gains, np.int64), np.array(gain.layer, np.int64)


def divided(ranges: Normalisation) -> ForceGain:
    """Return the gain that makes of each reading its share of all, on the scale of the ranges.

    It is 1 where the sum is that of the middles of all taxel ranges.
    """
    middle = float(np.sum(ranges.low.astype(np.float64) + ranges.high)) / 2.0
    shift = _shift(float(np.sum(ranges.high, dtype=np.int64)))
    sums = np.arange(KNOTS + 1) * float(1 << shift)
    gains = np.divide(middle, sums, out=np.full(KNOTS + 1, LIMIT_C), where=sums > 0)
    return ForceGain(shift, (_in_units(gains),), (0,) * ranges.n_taxels)


def calibrated(
    forces_g: Floats,
    curves: Floats,
    layer: Sequence[int],
    reference_g: float = REFERENCE_FORCE_G,
) -> ForceGain:
    """Return the gain from each layer's mean curve on a smooth plate.

    ``curves``: float64 (n_forces, n_taxels), mean readings at ``forces_g``, ascending. A plate
    never lies quite even, so one taxel's curve is that of its mounting too; over a layer a tilt
    averages out. Beyond the calibrated forces the gain of the nearest one holds.
    """
    sums = np.maximum.accumulate(curves.sum(axis=1))
    shift = _shift(float(sums[-1]))
    forces_at_knots = np.interp(np.arange(KNOTS + 1) * float(1 << shift), sums, forces_g)
    of_layer = np.array(layer)
    gains = []
    for number in range(max(layer) + 1):
        mean = curves[:, of_layer == number].mean(axis=1)
        at_reference = float(np.interp(reference_g, forces_g, mean))
        gains.append(_in_units(at_reference / np.interp(forces_at_knots, forces_g, mean)))
    return ForceGain(shift, tuple(gains), tuple(layer))


def _shift(highest_sum: float) -> int:
    """Return the width of a step, as a power of 2, with which the steps reach the sum."""
    return max(0, int(np.ceil(np.log2(max(highest_sum, 1.0) / KNOTS))))


def _in_units(gains: Floats) -> tuple[int, ...]:
    return tuple(np.clip(np.rint(gains * UNIT), 0, HIGHEST_GAIN).astype(int).tolist())
