"""The sensor: 18 taxels in two layers under a skin that blurs, lags and relaxes.

Levels are shares of the supply as the converter sees them, once a millisecond; a reading is
taken between two of them at its own instant. Taxels count row by row along the travel, the top
layer first; they are read as ``arduino/README.md`` draws the wiring, and levels, counts, dead and
stuck taxels are in the order of the readings.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.contact import (
    DEPTH_CELLS,
    N_PLACES,
    N_TOP,
    ContactTables,
    Mounting,
    missed,
    places_along,
)
from rigctl.simulation.bench.mechanics import (
    CELLS_PER_MM,
    CONTACTS,
    DEPTH_MM,
    DRUM_MM,
    FORCE_G,
    RING_MS,
    Mechanics,
)
from rigctl.simulation.bench.noise import NoiseRows, Stream, generator
from rigctl.simulation.bench.numba_options import around, compiled, inlined
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.bench.textures import GRID_MM
from rigctl.values import DRAWN_WIRING, N_TAXELS

FULL_COUNTS = 1023
SLOT_US = 50
STUCK_LEVEL = 0.6
SENSOR_SERIAL = 1
"""Which sensor this is: its gains are its own, whatever the seed of the session."""

_LINES, _INPUTS = 3, 6
(
    _TURN_MM,
    _FAST,
    _SLOW,
    _RELAX,
    _REST,
    _FRICTION,
    _CROSSTALK,
    _DEPTH_CELLS,
    _SHIFT,
    _TEXTURE,
) = range(10)
_ALONG, _MISSED, _GAIN = range(3)
_READING = np.array(DRAWN_WIRING)
_Floats = NDArray[np.float64]
_Table = NDArray[np.float32]
NO_JITTER: NDArray[np.float32] = np.zeros((0, N_PLACES), np.float32)


@inlined
def _touch(
    felt: _Floats, table: _Table, mean: _Table, taxels: _Floats, row: _Floats, c: _Floats
) -> None:
    """What the taxels feel; the layers lie over each other."""
    depths, size = table.shape[0], table.shape[1]
    first = around(row[DRUM_MM] + c[_SHIFT], c[_TURN_MM]) * CELLS_PER_MM
    for i in range(N_PLACES):
        cell = (row[DEPTH_MM] - taxels[_MISSED, i]) * c[_DEPTH_CELLS]
        if cell <= 0.0:
            felt[i] = felt[N_TOP + i] = 0.0
            continue
        deep = min(int(cell), depths - 2)
        more = cell - deep
        cell = first + taxels[_ALONG, i] * CELLS_PER_MM
        cell += size if cell < 0.0 else 0.0
        low = int(cell)
        share = cell - low
        low = low - size if low >= size else low
        behind = low + 1 if low + 1 < size else 0
        less, deeper = table[deep], table[deep + 1]
        for layer in range(2):
            above = less[low, layer] + (less[behind, layer] - less[low, layer]) * share
            below = deeper[low, layer] + (deeper[behind, layer] - deeper[low, layer]) * share
            level = mean[deep, layer] + (mean[deep + 1, layer] - mean[deep, layer]) * more
            texture = above + (below - above) * more - level
            felt[N_TOP * layer + i] = max(0.0, level + c[_TEXTURE] * texture)


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
        if row[FORCE_G] > 0.0 and abs(row[DRUM_MM] - before[DRUM_MM]) > 1e-4:
            return True
    return False


@compiled
def _feel(
    levels: _Floats,
    pressure: _Floats,
    log: _Floats,
    table: _Table,
    mean: _Table,
    taxels: _Floats,
    c: _Floats,
    reading: NDArray[np.int64],
    jitter: NDArray[np.float32],
    first_ms: int,
    count: int,
) -> None:
    """Levels of ``count`` milliseconds from ``first_ms`` on, in the order of the readings.

    ``pressure`` (2, n): fast and slow part now; ``table`` (depths, places, 2) and ``mean``
    (depths, 2): as :class:`ContactTables` has them; ``taxels`` (3, n): place along the travel,
    depth missed, gain; ``reading`` (n,): which reading shows each taxel; ``jitter`` (count, 9),
    or none at all where nothing slides under pressure.
    """
    felt, level = np.zeros(N_TAXELS), np.zeros(N_TAXELS)
    for k in range(count):
        row = log[(first_ms + k) % RING_MS]
        before = log[(first_ms + k - 1) % RING_MS]
        out = levels[(first_ms + k) % RING_MS]
        if row[FORCE_G] > 0.0:
            _touch(felt, table, mean, taxels, row, c)
            if abs(row[DRUM_MM] - before[DRUM_MM]) > 1e-4:
                for i in range(N_PLACES):
                    rubbing = 1.0 + c[_FRICTION] * jitter[k, i]
                    felt[i] *= rubbing
                    felt[N_TOP + i] *= rubbing
        else:
            felt[:] = 0.0
        for i in range(N_TAXELS):
            pressure[0, i] += (felt[i] - pressure[0, i]) * c[_FAST]
            pressure[1, i] += (pressure[0, i] - pressure[1, i]) * c[_SLOW]
            lasting = max(0.0, pressure[0, i] - c[_RELAX] * pressure[1, i])
            conductance = c[_REST] + taxels[_GAIN, i] * lasting
            level[i] = conductance / (1.0 + conductance)
        for i in range(N_TAXELS):
            out[reading[i]] = level[i]
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
    each reading's divider gives at that world millisecond, without the converter's noise.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        seed: int,
        plant: Mechanics,
        helper: Executor | None = None,
    ) -> None:
        self._p = parameters
        self._seed = seed
        self._plant = plant
        self._friction = NoiseRows(seed, Stream.FRICTION, N_PLACES, helper)
        self._adc = NoiseRows(seed, Stream.ADC, N_TAXELS, helper)
        self._constants = _constants(parameters)
        self._own_gains = _gains(parameters, seed)
        self._taxels = np.zeros((3, N_TAXELS))
        self._pressure = np.zeros((2, N_TAXELS))
        cells = round(parameters.circumference_mm / GRID_MM)
        self._table = np.zeros((DEPTH_CELLS, cells, 2), np.float32)
        self._mean = np.zeros((DEPTH_CELLS, 2), np.float32)
        self._contact_gains = self._seat_gains = np.ones(N_TAXELS)
        self._contact = 0
        self.time_ms = 0
        rest = parameters.rest_conductance / (1.0 + parameters.rest_conductance)
        self.levels = np.full((RING_MS, N_TAXELS), rest)

    def set_plate(self, tables: ContactTables, mounting: Mounting) -> None:
        """Put another plate under the drum from the plant's present time on."""
        self.advance()
        self._table, self._mean = tables.felt, tables.mean
        self._constants[_DEPTH_CELLS] = 1.0 / tables.cell_mm
        self._taxels[_ALONG] = np.tile(places_along(self._p, mounting), 2)
        self._taxels[_MISSED] = np.tile(missed(self._p, mounting), 2)
        self._seat_gains = mounting.gains
        self._set_gains()

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
            self._table,
            self._mean,
            self._taxels,
            self._constants,
            _READING,
            jitter,
            self.time_ms + 1,
            count,
        )
        for readings, level in ((self._p.dead_taxels, 0.0), (self._p.stuck_taxels, STUCK_LEVEL)):
            for reading in readings:
                rows = np.arange(self.time_ms + 1, self.time_ms + 1 + count) % RING_MS
                self.levels[rows, reading] = level
        self.time_ms += count

    def _settle_anew(self, contact: int) -> None:
        """Every contact finds skin and fabric a little changed."""
        p, random = self._p, generator(self._seed, Stream.CONTACT, contact)
        self._contact = contact
        shift, texture, gain = random.standard_normal(3)
        self._constants[_SHIFT] = p.contact_shift_mm * shift
        self._constants[_TEXTURE] = math.exp(p.contact_texture_spread * texture)
        each = p.contact_spread * random.standard_normal(N_TAXELS)
        self._contact_gains = np.exp(p.contact_load_spread * gain + each)
        self._set_gains()

    def _set_gains(self) -> None:
        self._taxels[_GAIN] = self._own_gains * self._seat_gains * self._contact_gains


def _constants(p: WorldParameters) -> _Floats:
    return np.array(
        [
            p.circumference_mm,
            1.0 - math.exp(-1.0 / p.viscous_lag_ms),
            1.0 - math.exp(-1e-3 / p.relaxation_s),
            p.relaxation,
            p.rest_conductance,
            p.friction_noise,
            p.crosstalk,
            0.0,
            0.0,
            1.0,
        ]
    )


def _gains(p: WorldParameters, seed: int) -> _Floats:
    """Gain of each taxel: the layer's, the sensor's own spread, the session's change."""
    layer = np.where(np.arange(N_TAXELS) < N_TOP, p.top_gain, p.bottom_gain)
    own = generator(SENSOR_SERIAL, Stream.SENSOR).standard_normal(N_TAXELS)
    session = generator(seed, Stream.SESSION).standard_normal(N_TAXELS)
    gains: _Floats = layer * np.exp(p.gain_spread * own + p.session_spread * session)
    return gains
