"""Sums over the readings of a trial as they come, from which its quality is judged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigctl.config.rig_config import ADC_MAX
from rigctl.kernels import compiled
from rigctl.session.data_quality import CellStatistics, Floats, TrialStatistics

_SUM, _SQUARES, _STEPS, _LOW, _HIGH, _AT_TOP = range(6)


@compiled
def _add(samples: NDArray[np.uint16], last: Floats, top: float, sums: Floats) -> None:
    """Add samples to the rows of ``sums``; float64 is exact for sums of whole numbers."""
    for row in range(samples.shape[0]):
        for taxel in range(samples.shape[1]):
            value = float(samples[row, taxel])
            step = value - last[taxel]
            last[taxel] = value
            sums[_SUM, taxel] += value
            sums[_SQUARES, taxel] += value * value
            sums[_STEPS, taxel] += step * step
            sums[_LOW, taxel] = min(sums[_LOW, taxel], value)
            sums[_HIGH, taxel] = max(sums[_HIGH, taxel], value)
            sums[_AT_TOP, taxel] += value >= top


class TrialSums:
    """Sums over the samples of a trial, which need no memory of them.

    ``top``: the highest reading. ``unit``: the readings of a count of its statistics, by default
    those of a 1,024th of the range, so that the limits hold for a sensor of any resolution.
    """

    def __init__(self, n_taxels: int, top: int = ADC_MAX, unit: float | None = None) -> None:
        self.n = 0
        self._top = top
        self._unit = (top + 1) / (ADC_MAX + 1) if unit is None else unit
        self.sa_spikes = 0
        self._sums = np.zeros((6, n_taxels))
        self._sums[_LOW] = top
        self._last = np.zeros(n_taxels)

    def add(self, samples: NDArray[np.uint16]) -> None:
        """Add the next samples, uint16 (n, n_taxels), n at least 1."""
        if self.n == 0:
            self._last[:] = samples[0]
        self.n += len(samples)
        _add(samples, self._last, self._top, self._sums)

    def add_spikes(self, spikes: NDArray[np.uint8]) -> None:
        """Add the spikes of the next samples, uint8 (n, 2·n_taxels), SA and RA."""
        self.sa_spikes += int(np.count_nonzero(spikes[:, : len(self._last)]))

    @property
    def mean(self) -> Floats:
        """Mean reading, counts, float64 (n_taxels,)."""
        return np.asarray(self._sums[_SUM] / self.n)

    def statistics(
        self, baseline: Floats | None = None, cell: CellStatistics | None = None
    ) -> TrialStatistics:
        """Return the statistics; ``baseline``: the mean of the lifted readings before."""
        unknown, unit = np.full(len(self._last), np.nan), self._unit
        variance = np.maximum(self._sums[_SQUARES] / self.n - self.mean**2, 0.0)
        return TrialStatistics(
            self.mean / unit,
            np.sqrt(variance) / unit,
            np.sqrt(self._sums[_STEPS] / max(self.n - 1, 1) / 2.0) / unit,
            self._sums[_LOW] / unit,
            self._sums[_HIGH] / unit,
            self._sums[_AT_TOP] / self.n,
            unknown if baseline is None else baseline / unit,
            CellStatistics() if cell is None else cell,
            self.sa_spikes,
        )
