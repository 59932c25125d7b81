"""The sensor: 18 taxels in two layers under a skin that blurs, lags and saturates.

Levels are shares of the supply as the converter sees them, once a millisecond; a reading is
taken between two of them at its own instant. Reading *i* is row ``i % 9 // 3`` along the
travel, column ``i % 3`` across it, top layer for *i* < 9.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from rigctl.values import N_TAXELS
from rigctl.world.compiled import compiled, inlined
from rigctl.world.noise import NoiseRows, Stream, generator
from rigctl.world.parameters import WorldParameters
from rigctl.world.plant import CONTACTS, DEPTH_MM, DRUM_MM, RING_MS, Plant
from rigctl.world.textures import GRID_MM, HeightTables

FULL_COUNTS = 1023
SLOT_US = 50
N_TOP = 9
STUCK_LEVEL = 0.6
SENSOR_SERIAL = 1
"""Which sensor this is: its gains are its own, whatever the seed of the session."""

_LINES, _INPUTS = 3, 6
_TURN_MM, _FAST, _SLOW, _RELAX, _REST, _FRICTION, _SOFT, _CROSSTALK, _SHIFT = range(9)
_Floats = NDArray[np.float64]
NO_JITTER: NDArray[np.float32] = np.zeros((0, N_TAXELS), np.float32)


@inlined
def _around(place_mm: float, turn_mm: float) -> float:
    """``place_mm % turn_mm`` to the bit; a turn of whole millimetres needs no long division."""
    if turn_mm != math.floor(turn_mm):
        return place_mm % turn_mm
    within = place_mm - math.floor(place_mm / turn_mm) * turn_mm
    return within + turn_mm if within < 0.0 else within


@inlined
def _touch(felt: _Floats, heights: _Floats, along: _Floats, drum_mm: float, c: _Floats) -> None:
    """Heights under the taxels; the layers lie over each other."""
    size = heights.shape[1]
    for i in range(N_TOP):
        cell = _around(drum_mm + along[i] + c[_SHIFT], c[_TURN_MM]) / GRID_MM
        low = int(cell)
        share = cell - low
        low = low - size if low >= size else low
        behind = low + 1 if low + 1 < size else 0
        felt[i] = heights[0, low] * (1.0 - share) + heights[0, behind] * share
        felt[N_TOP + i] = heights[1, low] * (1.0 - share) + heights[1, behind] * share


@inlined
def _crosstalk(levels: _Floats, share: float) -> None:
    """Lines that are not driven are held low, so a column's readings pull at each other."""
    for column in range(_INPUTS):
        mean = 0.0
        for line in range(_LINES):
            mean += levels[line * _INPUTS + column] / _LINES
        for line in range(_LINES):
            reading = line * _INPUTS + column
            levels[reading] += share * (mean - levels[reading])


@compiled
def _rubbed(log: _Floats, first_ms: int, count: int) -> bool:
    """Something slides under pressure in one of these milliseconds."""
    for ms in range(first_ms, first_ms + count):
        row, before = log[ms % RING_MS], log[(ms - 1) % RING_MS]
        if row[DEPTH_MM] > 0.0 and abs(row[DRUM_MM] - before[DRUM_MM]) > 1e-4:
            return True
    return False


@compiled
def _feel(
    levels: _Floats,
    pressure: _Floats,
    log: _Floats,
    heights: _Floats,
    taxels: _Floats,
    c: _Floats,
    jitter: NDArray[np.float32],
    first_ms: int,
    count: int,
) -> None:
    """Levels of ``count`` milliseconds from ``first_ms`` on.

    ``pressure`` (2, n): fast and slow part now; ``heights`` (2, cells): top and bottom;
    ``taxels`` (3, n): place along the travel, depth missed by the curve, gain; ``jitter``
    (count, n), or none at all where nothing slides under pressure.
    """
    felt = np.zeros(N_TAXELS)
    for k in range(count):
        row = log[(first_ms + k) % RING_MS]
        before = log[(first_ms + k - 1) % RING_MS]
        out = levels[(first_ms + k) % RING_MS]
        if row[DEPTH_MM] > 0.0:
            _touch(felt, heights, taxels[0], row[DRUM_MM], c)
            if abs(row[DRUM_MM] - before[DRUM_MM]) > 1e-4:
                for i in range(N_TAXELS):
                    felt[i] += c[_FRICTION] * jitter[k, i]
        for i in range(N_TAXELS):
            depth = max(0.0, row[DEPTH_MM] - taxels[1, i])
            indentation = max(0.0, depth + felt[i] * depth / (depth + c[_SOFT]))
            pressure[0, i] += (indentation - pressure[0, i]) * c[_FAST]
            pressure[1, i] += (pressure[0, i] - pressure[1, i]) * c[_SLOW]
            lasting = pressure[0, i] - c[_RELAX] * pressure[1, i]
            conductance = c[_REST] + taxels[2, i] * lasting
            out[i] = conductance / (1.0 + conductance)
        _crosstalk(out, c[_CROSSTALK])


@compiled
def _convert(
    levels: _Floats, starts_us: _Floats, slot_us: float, noise: NDArray[np.float32], rms: float
) -> NDArray[np.uint16]:
    counts = np.empty((starts_us.size, levels.shape[1]), np.uint16)
    for frame in range(starts_us.size):
        for i in range(levels.shape[1]):
            at_ms = (starts_us[frame] + i * slot_us) * 1e-3
            low = int(at_ms)
            share = at_ms - low
            here, after = levels[low % RING_MS, i], levels[(low + 1) % RING_MS, i]
            level = here * (1.0 - share) + after * share
            value = level * FULL_COUNTS + rms * noise[frame, i] + 0.5
            counts[frame, i] = int(min(max(value, 0.0), float(FULL_COUNTS)))
    return counts


class Skin:
    """The sensor of one session, lying still under the drum.

    ``levels``: float64 (RING_MS, 18), row ``ms % RING_MS`` is the share of the supply that
    each taxel's divider gives at that world millisecond, without the converter's noise.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        seed: int,
        plant: Plant,
        helper: Executor | None = None,
    ) -> None:
        self._p = parameters
        self._seed = seed
        self._plant = plant
        self._friction = NoiseRows(seed, Stream.FRICTION, N_TAXELS, helper)
        self._adc = NoiseRows(seed, Stream.ADC, N_TAXELS, helper)
        self._constants = _constants(parameters)
        self._own_gains = _gains(parameters, seed)
        self._taxels = np.stack([*_places(parameters), self._own_gains])
        self._pressure = np.zeros((2, N_TAXELS))
        self._heights = np.zeros((2, round(parameters.circumference_mm / GRID_MM)))
        self._contact = 0
        self.time_ms = 0
        rest = parameters.rest_conductance / (1.0 + parameters.rest_conductance)
        self.levels = np.full((RING_MS, N_TAXELS), rest)

    def set_heights(self, tables: HeightTables) -> None:
        """Put another plate under the drum from the plant's present time on."""
        self.advance()
        self._heights = np.stack([tables.top, tables.bottom])

    def advance(self) -> None:
        """Follow the plant up to its present time; at most RING_MS / 2 at once."""
        until_ms = self._plant.time_ms
        if self._plant.contacts == self._contact and until_ms > self.time_ms:
            self._run(until_ms - self.time_ms)
        while self.time_ms < until_ms:
            rows = np.arange(self.time_ms + 1, until_ms + 1) % RING_MS
            contacts = self._plant.log[rows, CONTACTS]
            if contacts[0] != self._contact:
                self._settle_anew(int(contacts[0]))
            changed = np.flatnonzero(contacts != contacts[0])
            self._run(int(changed[0]) if changed.size else rows.size)

    def read(self, first_frame: int, starts_us: _Floats, slot_us: float) -> NDArray[np.uint16]:
        """Counts uint16 (n, 18) of frames that start at these world times; ``advance`` first.

        ``first_frame`` numbers the first of them since power-up: it picks the noise.
        """
        noise = self._adc.rows(first_frame, starts_us.size)
        counts: NDArray[np.uint16] = _convert(
            self.levels, starts_us, slot_us, noise, self._p.adc_noise_counts
        )
        return counts

    def _run(self, count: int) -> None:
        rubbed = _rubbed(self._plant.log, self.time_ms + 1, count)
        jitter = self._friction.rows(self.time_ms, count) if rubbed else NO_JITTER
        _feel(
            self.levels,
            self._pressure,
            self._plant.log,
            self._heights,
            self._taxels,
            self._constants,
            jitter,
            self.time_ms + 1,
            count,
        )
        if self._p.dead_taxels or self._p.stuck_taxels:
            self._break_taxels(count)
        self.time_ms += count

    def _break_taxels(self, count: int) -> None:
        rows = np.arange(self.time_ms + 1, self.time_ms + 1 + count) % RING_MS
        for taxel in self._p.dead_taxels:
            self.levels[rows, taxel] = 0.0
        for taxel in self._p.stuck_taxels:
            self.levels[rows, taxel] = STUCK_LEVEL

    def _settle_anew(self, contact: int) -> None:
        """Every contact finds the skin a little shifted and its gains a little changed."""
        random = generator(self._seed, Stream.CONTACT, contact)
        self._contact = contact
        self._constants[_SHIFT] = self._p.contact_shift_mm * random.standard_normal()
        change = np.exp(self._p.contact_spread * random.standard_normal(N_TAXELS))
        self._taxels[2] = self._own_gains * change


def _constants(p: WorldParameters) -> _Floats:
    return np.array(
        [
            p.circumference_mm,
            1.0 - math.exp(-1.0 / p.viscous_lag_ms),
            1.0 - math.exp(-1e-3 / p.relaxation_s),
            p.relaxation,
            p.rest_conductance,
            p.friction_noise_mm,
            p.soft_touch_mm,
            p.crosstalk,
            0.0,
        ]
    )


def _gains(p: WorldParameters, seed: int) -> _Floats:
    """Gain of each taxel: the layer's, the sensor's own spread, the session's change."""
    layer = np.where(np.arange(N_TAXELS) < N_TOP, p.top_gain, p.bottom_gain)
    own = generator(SENSOR_SERIAL, Stream.SENSOR).standard_normal(N_TAXELS)
    session = generator(seed, Stream.SESSION).standard_normal(N_TAXELS)
    gains: _Floats = layer * np.exp(p.gain_spread * own + p.session_spread * session)
    return gains


def _places(p: WorldParameters) -> tuple[_Floats, _Floats]:
    """Place along the travel and depth missed because the drum is round, mm."""
    reading = np.arange(N_TAXELS, dtype=np.float64)
    row = reading % N_TOP // 3 - 1.0
    column = reading % 3 - 1.0
    along = p.taxel_pitch_mm * (row + column * math.tan(math.radians(p.sensor_skew_deg)))
    radius_mm = p.circumference_mm / (2.0 * math.pi)
    missed: _Floats = p.curvature_share * (p.taxel_pitch_mm * row) ** 2 / (2.0 * radius_mm)
    return along, missed
