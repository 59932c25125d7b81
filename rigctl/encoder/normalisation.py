"""The range of each taxel, which maps integer readings to numbers from 0 to 1."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigctl.encoder.parameters import EncoderParameters
from rigctl.encoder.reading import FULL_SCALE, HIGHEST, Reading
from rigctl.errors import WrongUse


@dataclass(frozen=True, slots=True)
class Normalisation:
    """Lowest and highest reading of each taxel, uint16 (n_taxels,) each, in units of ``reading``.

    A reading r becomes (r − low) / (high − low), clipped to 0–1. A taxel whose range is empty
    (constant over the data) always reads 0. ``source`` describes where the range is from.
    Raises :class:`WrongUse` where a low end is above its high end.
    """

    low: NDArray[np.uint16]
    high: NDArray[np.uint16]
    source: str = "calibration"
    reading: Reading = Reading.COUNTS

    def __post_init__(self) -> None:
        if self.low.shape != self.high.shape or self.low.ndim != 1:
            raise WrongUse("taxel ranges need one low and one high end for each taxel")
        if bool(np.any(self.low > self.high)):
            taxel = int(np.flatnonzero(self.low > self.high)[0]) + 1
            raise WrongUse(f"taxel {taxel}: the low end of its range is above the high end")

    @property
    def n_taxels(self) -> int:
        """Number of taxels."""
        return int(self.low.shape[0])

    @property
    def scale(self) -> NDArray[np.float64]:
        """1 / (high − low), float64 (n_taxels,); 0 for a constant taxel."""
        width = self.high.astype(np.float64) - self.low
        return np.divide(1.0, width, out=np.zeros_like(width), where=width > 0)

    @property
    def constant_taxels(self) -> list[int]:
        """Taxels (counted from 1) without a signal in this range."""
        return [int(i) + 1 for i in np.flatnonzero(self.low == self.high)]

    def check_reading(self, parameters: EncoderParameters) -> None:
        """Raise WrongUse for parameters with another reading than that of the ranges."""
        if parameters.reading is not self.reading:
            raise WrongUse(
                f"the taxel ranges ({self.source}) are of {self.reading}, encoder "
                f"{parameters.name} takes {parameters.reading}: take ranges and encoder with the "
                "same reading"
            )

    def apply(self, samples: NDArray[np.uint16]) -> NDArray[np.float64]:
        """Return readings uint16 (n, n_taxels) as numbers from 0 to 1, float64, clipped."""
        low, high = self.low.astype(np.float64), self.high.astype(np.float64)
        clipped: NDArray[np.float64] = (np.clip(samples, low, high) - low) * self.scale
        return clipped

    def has_ranges_of(self, other: Normalisation) -> bool:
        """Return whether the ranges of all taxels are equal, wherever they are from."""
        return (
            self.reading is other.reading
            and np.array_equal(self.low, other.low)
            and np.array_equal(self.high, other.high)
        )

    def count_clipped(self, samples: NDArray[np.uint16]) -> NDArray[np.int64]:
        """Return the number of readings of each taxel outside its range, int64 (n_taxels,)."""
        outside = (samples < self.low) | (samples > self.high)
        counts: NDArray[np.int64] = np.sum(outside, axis=0, dtype=np.int64)
        return counts

    @classmethod
    def full_scale(
        cls, n_taxels: int, highest: int = FULL_SCALE, reading: Reading = Reading.COUNTS
    ) -> Normalisation:
        """Return the whole range of readings: the converter's, 0–1023, or a session's own."""
        highest = highest if reading is Reading.COUNTS else HIGHEST
        low = np.zeros(n_taxels, np.uint16)
        return cls(low, np.full(n_taxels, highest, np.uint16), f"full scale 0–{highest}", reading)

    @classmethod
    def from_samples(
        cls,
        recordings: Iterable[NDArray[np.uint16]],
        source: str,
        reading: Reading = Reading.COUNTS,
    ) -> Normalisation:
        """Return the minimum and maximum of each taxel over recordings, uint16 (n, n_taxels) each.

        Raises :class:`WrongUse` if there is no sample.
        """
        ends = [(part.min(axis=0), part.max(axis=0)) for part in recordings if len(part)]
        if not ends:
            raise WrongUse("no samples to take the taxel ranges from")
        low = np.min([lo for lo, _ in ends], axis=0).astype(np.uint16)
        high = np.max([hi for _, hi in ends], axis=0).astype(np.uint16)
        return cls(low, high, source, reading)


class RunningRange:
    """The range since the start, for a live view without a calibration; it only widens.

    A taxel's range is at least ``min_width`` counts wide: while nothing touches the sensor, a range
    as wide as the noise would make every neuron fire.
    """

    def __init__(
        self,
        n_taxels: int,
        min_width: int = 0,
        reading: Reading = Reading.COUNTS,
        highest: int = FULL_SCALE,
    ) -> None:
        self._reading = reading
        self._highest = highest
        self._min_width = min_width
        self._low = np.full(n_taxels, np.iinfo(np.uint16).max, np.uint16)
        self._high = np.zeros(n_taxels, np.uint16)

    def update(self, samples: NDArray[np.uint16]) -> bool:
        """Add samples uint16 (n, n_taxels); return True if the range of any taxel widened."""
        if len(samples) == 0:
            return False
        low = np.minimum(self._low, samples.min(axis=0))
        high = np.maximum(self._high, samples.max(axis=0))
        widened = bool(np.any(low != self._low) or np.any(high != self._high))
        self._low, self._high = low, high
        return widened

    @property
    def normalisation(self) -> Normalisation:
        """The range so far; before the first sample the converter's whole range."""
        if bool(np.any(self._low > self._high)):
            return Normalisation.full_scale(self._low.shape[0], self._highest, self._reading)
        least = self._low.astype(np.int64) + self._min_width
        high = np.minimum(np.maximum(self._high, least), np.iinfo(np.uint16).max)
        source = "running range since the start"
        return Normalisation(self._low, high.astype(np.uint16), source, self._reading)
