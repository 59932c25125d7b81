"""A gain on the SA current for the force that all taxels together show, sample by sample.

C needs the texture's label. This gain needs the sum of all taxels' currents at the same instant:
the more they give together, the harder the press, and the less each one counts. ``divided`` takes
the sum itself, so that each taxel becomes its share; ``calibrated`` takes the force that the sum
shows on a smooth plate, and stays within the calibrated forces. Both have one gain for all taxels:
``docs/explanation/force-invariance.md`` has what a gain for each taxel does.

All of it is integer arithmetic on one sample, without a state: any slicing of the samples, the
analysis and a board get the same bits.
"""

from __future__ import annotations

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


LOADCELL = "loadcell"
"""A scaling by the load cell's mean over a whole trial, which no live encoder has."""
GAINED = (ForceScaling.DIVIDED, ForceScaling.CALIBRATED, LOADCELL)
"""What gives a gain without a label."""


@dataclass(frozen=True, slots=True)
class ForceGain:
    """A gain over the sum of all readings above their taxels' ``base``.

    ``gains``: at 0, 1 … :data:`KNOTS` steps of 2 ** ``shift`` of the sum, in 1 / :data:`UNIT`; the
    last one holds for higher sums.
    """

    shift: int
    gains: tuple[int, ...]
    base: tuple[int, ...]

    def apply(self, readings: Samples) -> Samples:
        """Return readings uint16 (n, n_taxels) as they would be at the reference force."""
        # Imported here: the compiler takes long to load, and readers of sessions come this way.
        from rigctl.encoder.gain_kernel import scale

        out = np.empty_like(readings)
        scale(np.ascontiguousarray(readings), *_tables(self), self.shift, UNIT_BITS, out)
        return out


@lru_cache(maxsize=64)
def _tables(gain: ForceGain) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return gains and bases as arrays: to make them takes as long as to scale a batch."""
    return np.array(gain.gains, np.int64), np.array(gain.base, np.int64)


def divided(ranges: Normalisation) -> ForceGain:
    """Return the gain that makes of each current its share of all, on the scale of the ranges.

    It is 1 where the sum is that of the middles of all taxel ranges.
    """
    width = float(np.sum(ranges.high.astype(np.float64) - ranges.low))
    shift = _shift(width)
    sums = np.maximum(np.arange(KNOTS + 1) * float(1 << shift), 1.0)
    return ForceGain(shift, _in_units(width / 2.0 / sums), _base(ranges))


def calibrated(
    forces_g: Floats,
    curves: Floats,
    ranges: Normalisation,
    reference_g: float = REFERENCE_FORCE_G,
) -> ForceGain:
    """Return the gain from the curve of all taxels on a smooth plate.

    ``curves``: float64 (n_forces, n_taxels), mean readings at ``forces_g``, ascending. Beyond the
    calibrated forces the gain of the nearest one holds.
    """
    sums = _sums(curves, ranges)
    shift = _shift(float(sums[-1]))
    at_knots = np.clip(np.arange(KNOTS + 1) * float(1 << shift), sums[0], sums[-1])
    at_reference = float(np.interp(reference_g, forces_g, sums))
    return ForceGain(shift, _in_units(at_reference / at_knots), _base(ranges))


def at_force(
    force_g: float,
    forces_g: Floats,
    curves: Floats,
    ranges: Normalisation,
    reference_g: float = REFERENCE_FORCE_G,
) -> ForceGain:
    """Return the one gain of a known force, whatever the readings, from the same curve."""
    sums = _sums(curves, ranges)
    now, aim = np.interp((force_g, reference_g), forces_g, sums)
    return ForceGain(0, _in_units(np.full(KNOTS + 1, aim / now)), _base(ranges))


def _sums(curves: Floats, ranges: Normalisation) -> Floats:
    """Return the sum over all taxels at each force, at least 1 and never falling."""
    sums = np.maximum((curves - ranges.low).clip(min=0.0).sum(axis=1), 1.0)
    rising: Floats = np.maximum.accumulate(sums)
    return rising


def _base(ranges: Normalisation) -> tuple[int, ...]:
    return tuple(ranges.low.tolist())


def _shift(highest_sum: float) -> int:
    """Return the width of a step, as a power of 2, with which the steps reach the sum."""
    return max(0, int(np.ceil(np.log2(max(highest_sum, 1.0) / KNOTS))))


def _in_units(gains: Floats) -> tuple[int, ...]:
    return tuple(np.clip(np.rint(gains * UNIT), 0, HIGHEST_GAIN).astype(int).tolist())
