"""What the HX711 amplifier makes of the force: 24-bit counts, 80 a second by its own clock."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.mechanics import FELT_G, RING_MS, Mechanics
from rigctl.simulation.bench.noise import NoiseRows, Stream
from rigctl.simulation.bench.numba_options import compiled, inlined
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.simulated_rig import Disturbances, LoadcellFault

FULL_SCALE = 8_388_607
SETTLING_CONVERSIONS = 4

NEXT_US, NUMBER, CREPT_G, LAST_COUNTS, _STATE_SIZE = range(5)
"""What changes with a conversion, float64: when the next is ready, how many there were since the
supply came on, creep, and the value before."""

(
    PERIOD_US,
    _AVERAGE_MS,
    _CREEP_GAIN,
    _CREEP,
    _DRIFT_G,
    _DRIFT_S,
    _NOISE_G,
    _OFFSET,
    _UG,
    _FAULT,
    _GIVEN_SIZE,
) = range(11)
_SILENT, _FROZEN, _SATURATED = (
    int(fault) for fault in (LoadcellFault.SILENT, LoadcellFault.FROZEN, LoadcellFault.SATURATED)
)
_Floats = NDArray[np.float64]


@inlined
def _felt_g(log: _Floats, end_ms: int, count: int) -> float:
    total = 0.0
    for ms in range(end_ms - count + 1, end_ms + 1):
        total += log[ms % RING_MS, FELT_G]
    return total / count


@inlined
def weigh(
    state: _Floats, given: _Floats, log: _Floats, force_g: float, noise: float, at_us: float
) -> float:
    """Counts of a sound conversion that ends at ``at_us`` under this true contact force."""
    state[CREPT_G] += given[_CREEP_GAIN] * (force_g - state[CREPT_G])
    drift_g = given[_DRIFT_G] * math.sin(2.0 * math.pi * at_us * 1e-6 / given[_DRIFT_S])
    felt_g = _felt_g(log, int(at_us) // 1000, int(given[_AVERAGE_MS]))
    total_g = felt_g + drift_g + given[_CREEP] * state[CREPT_G] + given[_NOISE_G] * noise
    counts = np.rint(given[_OFFSET] + total_g * 1e6 / given[_UG])
    return float(max(-FULL_SCALE - 1.0, min(float(FULL_SCALE), counts)))


@inlined
def convert(state: _Floats, given: _Floats, log: _Floats, force_g: float, noise: float) -> bool:
    """Make the conversion that is due into ``LAST_COUNTS``; False where nothing is offered."""
    counts = weigh(state, given, log, force_g, noise, state[NEXT_US])
    state[NUMBER] += 1.0
    state[NEXT_US] = math.floor((state[NUMBER] + 1.0) * given[PERIOD_US])
    if given[_FAULT] == _SATURATED:
        state[LAST_COUNTS] = FULL_SCALE
    elif given[_FAULT] != _FROZEN:
        state[LAST_COUNTS] = counts
    return bool(given[_FAULT] != _SILENT)


@compiled
def _weigh(
    state: _Floats, given: _Floats, log: _Floats, force_g: float, noise: float, at_us: float
) -> float:
    return float(weigh(state, given, log, force_g, noise, at_us))


@compiled
def _convert(state: _Floats, given: _Floats, log: _Floats, force_g: float, noise: float) -> bool:
    return bool(convert(state, given, log, force_g, noise))


class LoadCellAmplifier:
    """One amplifier. A conversion is ready at ``next_us``; ``convert`` gives it.

    The plant must have run to the millisecond that ends at or before ``next_us``, not beyond
    the next one. Compiled code is handed ``state``, ``given`` and the noise of the conversions
    to come, and makes them by :func:`convert`.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, plant: Mechanics, disturbances: Disturbances
    ) -> None:
        self._plant = plant
        self._bench = disturbances
        rate_hz = parameters.loadcell_rate_hz * (1.0 + parameters.loadcell_clock_ppm * 1e-6)
        self.period_us = 1e6 / rate_hz
        self._noise = NoiseRows(seed, Stream.LOADCELL, 1)
        self._weighed = 0
        self.state = np.zeros(_STATE_SIZE)
        self.given = np.array(
            [
                self.period_us,
                round(parameters.loadcell_average_ms),
                1.0 - math.exp(-1.0 / (rate_hz * parameters.loadcell_creep_s)),
                parameters.loadcell_creep,
                parameters.loadcell_drift_g,
                parameters.loadcell_drift_s,
                parameters.loadcell_noise_g,
                parameters.loadcell_offset_counts,
                parameters.loadcell_ug_per_count,
                0.0,
            ]
        )
        # Those of the settling are made, and offered to nobody.
        self.state[NUMBER] = SETTLING_CONVERSIONS - 1
        self.state[NEXT_US] = math.floor(SETTLING_CONVERSIONS * self.period_us)

    @property
    def next_us(self) -> int:
        """World time at which the next conversion is ready."""
        return int(self.state[NEXT_US])

    def noise(self, until_us: int) -> NDArray[np.float32]:
        """Standard normal noise, float32 (n,), of all conversions up to a world time."""
        count = 2 + int(max(0.0, until_us - self.state[NEXT_US]) / self.period_us)
        self.given[_FAULT] = self._bench.loadcell
        return self._noise.rows(int(self.state[NUMBER]), count).reshape(-1)

    def convert(self) -> int | None:
        """Raw counts of the conversion due at ``next_us``; None when the amplifier is silent."""
        noise = float(self.noise(self.next_us)[0])
        force_g = self._plant.force_g
        there = _convert(self.state, self.given, self._plant.log, force_g, noise)
        return int(self.state[LAST_COUNTS]) if there else None

    def weigh(self, at_us: int) -> int:
        """Raw counts of a sound conversion that ends now, by somebody else's conversion clock."""
        noise = float(self._noise.rows(self._weighed, 1)[0, 0])
        self._weighed += 1
        force_g = self._plant.force_g
        return int(_weigh(self.state, self.given, self._plant.log, force_g, noise, float(at_us)))
