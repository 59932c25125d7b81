"""The HX711 load-cell amplifier: 24-bit counts, 80 a second by its own clock."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.circuit import Circuit
from rigctl.bench.mechanics import LOADCELL_G, RING_MS, Mechanics
from rigctl.bench.noise import NoiseRows, NoiseStream
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.simulated_rig import Disturbances, LoadcellFault
from rigctl.kernels import compiled, inlined

FULL_SCALE = 8_388_607
SETTLING_CONVERSIONS = 4

NOISE_ROWS, RUN_ROWS = 256, 100
"""Conversions whose noise is fetched at once, and those of a second, the longest run, and more."""

SPIKE_G = 1000.0
"""By how much a single bad conversion is wrong."""

NEXT_US, NUMBER, CREEP_G, LAST_COUNTS, _ORIGIN_US, _ORIGIN, _WEIGHED, _STATE_SIZE = range(8)
"""Indices of ``state``, float64: time of the next conversion, number of conversions since
power-up, creep, the last value, time and number of the conversion from which the clock has its
present rate, and the number of values."""

PERIOD_US, _AVERAGE_MS, _CREEP_GAIN, _CREEP, _DRIFT_G = range(5)
_DRIFT_S, _NOISE_G, _OFFSET, _UG, _FAULT = range(5, 10)
_GAIN, _STRAY, _STRAY_NOISE, _SPIKE_EVERY, _CONSTANTS_SIZE = range(10, 15)
_SILENT, _FROZEN, _SATURATED = (
    int(fault) for fault in (LoadcellFault.SILENT, LoadcellFault.FROZEN, LoadcellFault.SATURATED)
)
_Floats = NDArray[np.float64]


@inlined
def _mean_g(log: _Floats, end_ms: int, count: int) -> float:
    total = 0.0
    for ms in range(end_ms - count + 1, end_ms + 1):
        total += log[ms % RING_MS, LOADCELL_G]
    return total / count


@inlined
def weigh(
    state: _Floats, constants: _Floats, log: _Floats, force_g: float, noise: float, at_us: float
) -> float:
    """Return the counts of a conversion that ends at ``at_us``."""
    state[CREEP_G] += constants[_CREEP_GAIN] * (force_g - state[CREEP_G])
    drift_g = constants[_DRIFT_G] * math.sin(2.0 * math.pi * at_us * 1e-6 / constants[_DRIFT_S])
    mean_g = _mean_g(log, int(at_us) // 1000, int(constants[_AVERAGE_MS]))
    creep_g, noise_g = constants[_CREEP] * state[CREEP_G], constants[_NOISE_G] * noise
    total_g = mean_g + drift_g + creep_g + noise_g
    signal = constants[_OFFSET] + total_g * 1e6 / constants[_UG]
    stray = constants[_STRAY] + constants[_STRAY_NOISE] * noise
    state[_WEIGHED] += 1.0
    if constants[_SPIKE_EVERY] > 0.0 and state[_WEIGHED] % constants[_SPIKE_EVERY] == 0.0:
        stray += SPIKE_G * 1e6 / constants[_UG]
    counts = np.rint(constants[_GAIN] * signal + stray)
    return float(max(-FULL_SCALE - 1.0, min(float(FULL_SCALE), counts)))


@inlined
def convert(state: _Floats, constants: _Floats, log: _Floats, force_g: float, noise: float) -> bool:
    """Store the due conversion in ``LAST_COUNTS``; return False if the amplifier is silent."""
    counts = weigh(state, constants, log, force_g, noise, state[NEXT_US])
    state[NUMBER] += 1.0
    since = state[NUMBER] + 1.0 - state[_ORIGIN]
    state[NEXT_US] = math.floor(state[_ORIGIN_US] + since * constants[PERIOD_US])
    if constants[_FAULT] == _SATURATED:
        state[LAST_COUNTS] = FULL_SCALE
    elif constants[_FAULT] != _FROZEN:
        state[LAST_COUNTS] = counts
    return bool(constants[_FAULT] != _SILENT)


@compiled
def _weigh(
    state: _Floats, constants: _Floats, log: _Floats, force_g: float, noise: float, at_us: float
) -> float:
    return float(weigh(state, constants, log, force_g, noise, at_us))


class LoadCellAmplifier:
    """One amplifier. Compiled code passes ``arrays`` and ``noise`` to :func:`convert`.

    The plant must have run to the millisecond that ends at or before the conversion's end
    (``NEXT_US`` of the state), but not beyond the next one.
    """

    def __init__(
        self, parameters: WorldParameters, seed: int, plant: Mechanics, disturbances: Disturbances
    ) -> None:
        self._plant = plant
        self._disturbances = disturbances
        self._rate_hz = parameters.loadcell_rate_hz * (1.0 + parameters.loadcell_clock_ppm * 1e-6)
        self._parameters = parameters
        self._noise = NoiseRows(seed, NoiseStream.LOADCELL, 1)
        self._noise_window: NDArray[np.float32] = np.zeros(0, np.float32)
        self._noise_first = 0
        self._weigh_count = 0
        self._state = np.zeros(_STATE_SIZE)
        self._constants = np.zeros(_CONSTANTS_SIZE)
        self._constants[: _FAULT + 1] = np.array(
            [
                1e6 / self._rate_hz,
                0.0,
                0.0,
                parameters.loadcell_creep,
                parameters.loadcell_drift_g,
                parameters.loadcell_drift_s,
                parameters.loadcell_noise_g,
                parameters.loadcell_offset_counts,
                parameters.loadcell_ug_per_count,
                0.0,
            ]
        )
        # The amplifier does not offer the conversions during which it settles.
        self._state[NUMBER] = SETTLING_CONVERSIONS - 1
        self._state[NEXT_US] = math.floor(SETTLING_CONVERSIONS * self.period_us)
        self.arrays = self._state, self._constants
        self.connect(disturbances.circuit)

    @property
    def period_us(self) -> float:
        """Present time from one conversion to the next."""
        return float(self._constants[PERIOD_US])

    def connect(self, circuit: Circuit) -> None:
        """Connect cell and amplifier in this way; a conversion that has begun ends as it would.

        A slower amplifier averages for a longer time.
        """
        p, rate_hz = self._parameters, self._rate_hz / circuit.cell_periods
        if 1e6 / rate_hz != self.period_us:
            since = self._state[NUMBER] + 1.0 - self._state[_ORIGIN]
            self._state[_ORIGIN_US] += since * self.period_us
            self._state[_ORIGIN] = self._state[NUMBER] + 1.0
        self._constants[[PERIOD_US, _AVERAGE_MS, _CREEP_GAIN]] = (
            1e6 / rate_hz,
            round(p.loadcell_average_ms * circuit.cell_periods),
            1.0 - math.exp(-1.0 / (rate_hz * p.loadcell_creep_s)),
        )
        self._constants[[_GAIN, _STRAY, _STRAY_NOISE, _SPIKE_EVERY]] = (
            circuit.cell_gain,
            circuit.cell_stray_counts,
            circuit.cell_noise_counts,
            circuit.cell_spike_every,
        )

    def noise(self) -> NDArray[np.float32]:
        """Return standard normal noise, float32 (n,), for the conversions of the next second."""
        has_data = self._disturbances.circuit.cell_data
        self._constants[_FAULT] = self._disturbances.loadcell if has_data else LoadcellFault.SILENT
        first = int(self._state[NUMBER])
        begin = first - self._noise_first
        if begin + RUN_ROWS > len(self._noise_window):
            self._noise_window = self._noise.rows(first, NOISE_ROWS).reshape(-1)
            self._noise_first, begin = first, 0
        return self._noise_window[begin:]

    def weigh(self, at_us: int) -> int:
        """Return raw counts of a conversion, for a caller with its own clock."""
        noise = float(self._noise.rows(self._weigh_count, 1)[0, 0])
        self._weigh_count += 1
        log, force_g = self._plant.log, self._plant.force_g
        return int(_weigh(self._state, self._constants, log, force_g, noise, float(at_us)))
