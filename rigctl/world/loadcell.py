"""What the HX711 amplifier makes of the force: 24-bit counts, 80 a second by its own clock."""

from __future__ import annotations

import math

from rigctl.world.noise import NoiseRows, Stream
from rigctl.world.parameters import WorldParameters
from rigctl.world.plant import FELT_G, RING_MS, Plant
from rigctl.world.simulation import Disturbances, LoadcellFault

FULL_SCALE = 8_388_607
SETTLING_CONVERSIONS = 4


class Loadcell:
    """One amplifier. A conversion is ready at ``next_us``; ``convert`` gives it.

    The plant must have run to the millisecond that ends at or before ``next_us``, not beyond
    the next one. Compiled code that makes conversions itself tells so by :meth:`converted`.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, plant: Plant, disturbances: Disturbances
    ) -> None:
        self._p = parameters
        self._plant = plant
        self._bench = disturbances
        rate_hz = parameters.loadcell_rate_hz * (1.0 + parameters.loadcell_clock_ppm * 1e-6)
        self.period_us = 1e6 / rate_hz
        self.average_ms = round(parameters.loadcell_average_ms)
        self.creep_gain = 1.0 - math.exp(-1.0 / (rate_hz * parameters.loadcell_creep_s))
        self.crept_g = 0.0
        self._last_counts = 0
        self.number = 0
        self.noise = NoiseRows(seed, Stream.LOADCELL, 1)
        self.power_up(0)

    def power_up(self, at_us: int) -> None:
        """Supply on, or clock line low again: the first conversion comes after settling."""
        self.origin_us = at_us + (SETTLING_CONVERSIONS - 1) * self.period_us
        self.since_origin = 0
        self._schedule()

    def convert(self) -> int | None:
        """Raw counts of the conversion due at ``next_us``; None when the amplifier is silent."""
        counts = self.weigh(self.next_us)
        self._schedule()
        if self._bench.loadcell is LoadcellFault.SILENT:
            return None
        if self._bench.loadcell is LoadcellFault.SATURATED:
            return FULL_SCALE
        if self._bench.loadcell is not LoadcellFault.FROZEN:
            self._last_counts = counts
        return self._last_counts

    def converted(self, count: int, next_us: int, crept_g: float, last_counts: int) -> None:
        """So many sound conversions were made elsewhere, from :attr:`next_us` on."""
        self.number += count
        self.since_origin += count
        self.next_us, self.crept_g, self._last_counts = next_us, crept_g, last_counts

    def weigh(self, at_us: int) -> int:
        """Raw counts of a sound conversion that ends now; each call is a conversion of its own."""
        force_g = self._felt_g(at_us // 1000) + self._slow_g(at_us) + self._noise_g()
        return self._counts(force_g)

    def _schedule(self) -> None:
        self.since_origin += 1
        self.next_us = int(self.origin_us + self.since_origin * self.period_us)

    def _felt_g(self, end_ms: int) -> float:
        end = end_ms % RING_MS + 1
        first = end - self.average_ms
        if first >= 0:
            return float(self._plant.log[first:end, FELT_G].sum()) / self.average_ms
        wrapped = self._plant.log[first:, FELT_G].sum() + self._plant.log[:end, FELT_G].sum()
        return float(wrapped) / self.average_ms

    def _slow_g(self, at_us: int) -> float:
        """Drift of the bridge and creep of its glue."""
        self.crept_g += self.creep_gain * (self._plant.force_g - self.crept_g)
        drift = math.sin(2.0 * math.pi * at_us * 1e-6 / self._p.loadcell_drift_s)
        return self._p.loadcell_drift_g * drift + self._p.loadcell_creep * self.crept_g

    def _noise_g(self) -> float:
        noise = float(self.noise.rows(self.number, 1)[0, 0])
        self.number += 1
        return self._p.loadcell_noise_g * noise

    def _counts(self, force_g: float) -> int:
        counts = self._p.loadcell_offset_counts + force_g * 1e6 / self._p.loadcell_ug_per_count
        return max(-FULL_SCALE - 1, min(FULL_SCALE, round(counts)))
