"""The sensor: taxels in layers under a skin that blurs, lags and relaxes.

The skin computes conductances, one row a millisecond; a reading interpolates between two rows at
its own time. The taxels of an input share its divider, and the lines that are not driven are held
low, so each loads the others (:func:`divider_share`). Taxels count row by row along the travel, the
top layer first. Conductances, counts, dead and stuck taxels are in the order of the readings, which
follow the wiring in ``arduino/README.md``.
"""

from __future__ import annotations

import math
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.contact import (
    N_DEPTHS,
    ContactTables,
    Mounting,
    Shape,
    depth_offsets_mm,
    gives_mm_g,
    of_layers,
    positions_along_mm,
)
from rigctl.bench.mechanics import (
    CELLS_PER_MM,
    CONTACTS,
    DEPTH_MM,
    DRUM_MM,
    FORCE_G,
    RING_MS,
    Mechanics,
)
from rigctl.bench.noise import NoiseRows, NoiseStream, modulo, random_generator
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import GRID_MM
from rigctl.bench.touch import NO_TOUCH
from rigctl.config.rig_config import PAPER_ARRAY, TaxelArray
from rigctl.kernels import compiled, inlined, uncounted

FULL_COUNTS = 1023
SLOT_US = 50
SHORTED = 1e6
"""Conductance of a taxel that is shorted, in units of the divider's."""
NOMINAL_DIVIDER_KOHM = 10.0
LASTING_PRESSURE = 1e-6
"""A pressure that ebbs below this rests exactly: it moves a reading by less than 0.001 counts, and
without an end its exponential would reach into every later contact."""
SENSOR_SERIAL = 1
"""Seeds the sensor's own gains, which do not depend on the session's seed."""

_TURN_MM, _FAST, _SLOW, _RELAX, _REST = range(5)
_FRICTION, _DEPTH_CELLS, _SHIFT, _TEXTURE = range(5, 9)
_ALONG, _OFFSET, _GAIN, _GIVE = range(4)
_Floats = NDArray[np.float64]
_Table = NDArray[np.float32]
NO_JITTER: NDArray[np.float32] = np.zeros((0, 0), np.float32)


@inlined
def _sense_contact(
    sensed: _Floats, table: _Table, mean: _Table, taxels: _Floats, log: _Floats, at: int, c: _Floats
) -> None:
    """Look up the conductance of all layers at every site; row ``at`` of ``log`` is the present."""
    depths, size, n_layers = table.shape
    n_sites = sensed.size // n_layers
    depth_mm, force_g = log[at, DEPTH_MM], log[at, FORCE_G]
    cells_per_mm, gain = c[_DEPTH_CELLS], c[_TEXTURE]
    first = modulo(log[at, DRUM_MM] + c[_SHIFT], c[_TURN_MM]) * CELLS_PER_MM
    for i in range(n_sites):
        offset_mm = taxels[_OFFSET, i] + taxels[_GIVE, i] * force_g
        cell = (depth_mm - offset_mm) * cells_per_mm
        if cell <= 0.0:
            for layer in range(n_layers):
                sensed[n_sites * layer + i] = 0.0
            continue
        depth = min(int(cell), depths - 2)
        more = cell - depth
        cell = first + taxels[_ALONG, i] * CELLS_PER_MM
        cell += size if cell < 0.0 else 0.0
        low = int(cell)
        share = cell - low
        low = low - size if low >= size else low
        high = low + 1 if low + 1 < size else 0
        for layer in range(n_layers):
            left, right = table[depth, low, layer], table[depth, high, layer]
            above = left + (right - left) * share
            left, right = table[depth + 1, low, layer], table[depth + 1, high, layer]
            below = left + (right - left) * share
            level = mean[depth, layer] + (mean[depth + 1, layer] - mean[depth, layer]) * more
            texture = above + (below - above) * more - level
            sensed[n_sites * layer + i] = max(0.0, level + gain * texture)


@inlined
def divider_share(own: float, together: float) -> float:
    """Return the share of the supply that an input has while one of its taxels is driven.

    ``own``: that taxel's conductance; ``together``: the sum over all taxels of the input, whose
    other lines are low; both in units of the divider's conductance. ``arduino/sim/sensor.c``
    computes the same node with faults of the wiring, and
    :func:`rigctl.encoder.reading.conductance` undoes it.
    """
    return own / (together + 1.0)


@inlined
def _slides_at(log: _Floats, ms: int) -> bool:
    """Return whether the drum slides under pressure in this millisecond."""
    at, before = ms % RING_MS, (ms - 1) % RING_MS
    moved_mm = abs(log[at, DRUM_MM] - log[before, DRUM_MM])
    return bool(log[at, FORCE_G] > 0.0 and moved_mm > 1e-4)


@compiled
def _slides(log: _Floats, first_ms: int, count: int) -> bool:
    """Return whether the drum slides under pressure in one of these milliseconds."""
    ms, end_ms = first_ms, first_ms + count
    while ms < end_ms and not _slides_at(log, ms):
        ms += 1
    return ms < end_ms


@compiled
def _simulate(
    conductances: _Floats,
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
    """Compute the conductances of ``count`` milliseconds from ``first_ms`` on.

    ``pressure`` (2, n): fast and slow part, updated; ``table`` (depths, positions,
    layers) and ``mean`` (depths, layers): conductances of :class:`ContactTables`; ``taxels``
    (4, n): position along the travel, depth offset, gain, and what a gram adds to the offset;
    ``reading`` (n,): the reading of each taxel; ``jitter`` (count, sites), or empty if nothing
    slides under pressure.
    """
    conductances, pressure, log = uncounted(conductances), uncounted(pressure), uncounted(log)
    table, mean, jitter = uncounted(table), uncounted(mean), uncounted(jitter)
    taxels, c, reading = uncounted(taxels), uncounted(c), uncounted(reading)
    n_taxels = reading.size
    n_sites = n_taxels // table.shape[2]
    fast, slow, relax, rest = c[_FAST], c[_SLOW], c[_RELAX], c[_REST]
    sensed = np.zeros(n_taxels)
    for k in range(count):
        at = (first_ms + k) % RING_MS
        if log[at, FORCE_G] > 0.0:
            _sense_contact(sensed, table, mean, taxels, log, at, c)
            if _slides_at(log, first_ms + k):
                for i in range(n_sites):
                    friction = 1.0 + c[_FRICTION] * jitter[k, i]
                    for taxel in range(i, n_taxels, n_sites):
                        sensed[taxel] *= friction
        else:
            sensed[:] = 0.0
        for i in range(n_taxels):
            soon = pressure[0, i] + (sensed[i] - pressure[0, i]) * fast
            late = pressure[1, i] + (soon - pressure[1, i]) * slow
            if sensed[i] == 0.0:
                soon = 0.0 if soon < LASTING_PRESSURE else soon
                late = 0.0 if late < LASTING_PRESSURE else late
            pressure[0, i], pressure[1, i] = soon, late
            lasting = max(0.0, soon - relax * late)
            conductances[at, reading[i]] = rest + taxels[_GAIN, i] * lasting


@compiled
def _digitise(
    conductances: _Floats,
    starts_us: _Floats,
    slot_us: float,
    noise: NDArray[np.float32],
    rms: float,
    n_inputs: int,
) -> NDArray[np.uint16]:
    counts = np.empty((starts_us.size, conductances.shape[1]), np.uint16)
    for frame in range(starts_us.size):
        for i in range(conductances.shape[1]):
            at_ms = (starts_us[frame] + i * slot_us) * 1e-3
            low = int(at_ms)
            share = at_ms - low
            here, after = low % RING_MS, (low + 1) % RING_MS
            together = own = 0.0
            for reading in range(i % n_inputs, conductances.shape[1], n_inputs):
                each = conductances[here, reading] * (1.0 - share)
                each += conductances[after, reading] * share
                together += each
                own = each if reading == i else own
            value = divider_share(own, together) * FULL_COUNTS + rms * noise[frame, i] + 0.5
            counts[frame, i] = int(min(max(value, 0.0), float(FULL_COUNTS)))
    return counts


class Skin:
    """The sensor of one session, fixed under the drum.

    ``sensor``: rows, columns, layers and inputs; it is soldered as drawn, whatever its wiring says.
    ``conductances``: float64 (RING_MS, n_taxels); row ``ms % RING_MS`` holds that of each reading's
    taxel at that millisecond, in units of the divider's. ``executor``, if given, computes noise in
    advance. ``touch``: what a person does to the sensor now.
    """

    def __init__(
        self,
        parameters: WorldParameters,
        seed: int,
        plant: Mechanics,
        executor: Executor | None = None,
        sensor: TaxelArray = PAPER_ARRAY,
    ) -> None:
        n_taxels, self._shape, self._sensor = sensor.count, sensor.shape, sensor
        n_sites = self._shape[0] * self._shape[1]
        self._reading = np.array(sensor.drawn_order)
        self._p = parameters
        self._seed = seed
        self._plant = plant
        self._friction = NoiseRows(seed, NoiseStream.FRICTION, n_sites, executor)
        self._adc = NoiseRows(seed, NoiseStream.ADC, n_taxels, executor)
        self._constants = _constants(parameters)
        self._sensor_gains = _sensor_gains(parameters, seed, self._shape)
        self._taxels = np.zeros((4, n_taxels))
        self._pressure = np.zeros((2, n_taxels))
        cells = round(parameters.circumference_mm / GRID_MM)
        self._table = np.zeros((N_DEPTHS, cells, self._shape[2]), np.float32)
        self._mean = np.zeros((N_DEPTHS, self._shape[2]), np.float32)
        self._contact_gains = self._mounting_gains = np.ones(n_taxels)
        self._contact = 0
        self.time_ms = 0
        self.touch = NO_TOUCH
        self._map: _Floats | None = None
        self.conductances = np.full((RING_MS, n_taxels), self._constants[_REST])

    def set_plate(self, tables: ContactTables, mounting: Mounting) -> None:
        """Mount another plate at the plant's present time."""
        self.advance()
        self._table, self._mean = tables.conductance, tables.mean_conductance
        self._constants[_DEPTH_CELLS] = 1.0 / tables.cell_mm
        n_layers = self._shape[2]
        self._taxels[_ALONG] = np.tile(positions_along_mm(self._p, mounting, self._shape), n_layers)
        self._taxels[_OFFSET] = np.tile(depth_offsets_mm(self._p, mounting, self._shape), n_layers)
        self._taxels[_GIVE] = np.tile(gives_mm_g(mounting, self._shape), n_layers)
        self._mounting_gains = mounting.gains
        self._set_gains()

    def connect(self, taxel_map: _Floats | None) -> None:
        """Lead taxels to readings by :func:`rigctl.bench.electrics.taxel_map`."""
        self.advance()
        self._map = taxel_map

    def advance(self) -> None:
        """Simulate up to the plant's present time; at most RING_MS / 2 in one call."""
        until_ms = self._plant.time_ms
        if self._plant.contacts == self._contact and until_ms > self.time_ms:
            self._run(until_ms - self.time_ms)
        while self.time_ms < until_ms:
            rows = np.arange(self.time_ms + 1, until_ms + 1) % RING_MS
            contacts = self._plant.log[rows, CONTACTS]
            if contacts[0] != self._contact:
                self._begin_contact(int(contacts[0]))
            changed = np.flatnonzero(contacts != contacts[0])
            self._run(int(changed[0]) if changed.size else rows.size)

    def read(self, first_frame: int, starts_us: _Floats, slot_us: float) -> NDArray[np.uint16]:
        """Return uint16 (n, n_taxels), counts of frames that start then; ``advance`` first.

        ``first_frame``, the number of the first frame since power-up, selects the noise.
        """
        noise = self._adc.rows(first_frame, starts_us.size)
        counts: NDArray[np.uint16] = _digitise(
            self.conductances,
            starts_us,
            slot_us,
            noise,
            self._p.adc_noise_counts,
            self._sensor.inputs,
        )
        return counts

    def _run(self, count: int) -> None:
        slides = _slides(self._plant.log, self.time_ms + 1, count)
        jitter = self._friction.rows(self.time_ms, count) if slides else NO_JITTER
        _simulate(
            self.conductances,
            self._pressure,
            self._plant.log,
            self._table,
            self._mean,
            self._taxels,
            self._constants,
            self._reading,
            jitter,
            self.time_ms + 1,
            count,
        )
        is_changed = self.touch != NO_TOUCH or self._map is not None
        if is_changed or self._p.dead_taxels or self._p.stuck_taxels:
            self._change(np.arange(self.time_ms + 1, self.time_ms + 1 + count) % RING_MS)
        self.time_ms += count

    def _change(self, rows: NDArray[np.int64]) -> None:
        """Apply what a person does, and taxels that are dead or stuck."""
        conductances = self.conductances[rows]
        self.touch.apply(conductances, self._sensor)
        if self._map is not None:
            conductances = conductances @ self._map.T
        conductances[:, list(self._p.dead_taxels)] = 0.0
        conductances[:, list(self._p.stuck_taxels)] = SHORTED
        self.conductances[rows] = conductances

    def _begin_contact(self, contact: int) -> None:
        """Draw the small changes of skin and fabric that each contact brings."""
        p, random = self._p, random_generator(self._seed, NoiseStream.CONTACT, contact)
        self._contact = contact
        shift, texture, gain = random.standard_normal(3)
        self._constants[_SHIFT] = p.contact_shift_mm * shift
        self._constants[_TEXTURE] = math.exp(p.contact_texture_spread * texture)
        each = p.contact_spread * random.standard_normal(self._reading.size)
        self._contact_gains = np.exp(p.contact_load_spread * gain + each)
        self._set_gains()

    def _set_gains(self) -> None:
        self._taxels[_GAIN] = self._sensor_gains * self._mounting_gains * self._contact_gains


def _constants(p: WorldParameters) -> _Floats:
    return np.array(
        [
            p.circumference_mm,
            1.0 - math.exp(-1.0 / p.viscous_lag_ms),
            1.0 - math.exp(-1e-3 / p.relaxation_s),
            p.relaxation,
            p.rest_conductance * _divider(p),
            p.friction_noise,
            0.0,
            0.0,
            1.0,
        ]
    )


def _divider(p: WorldParameters) -> float:
    """Return the conductance of the nominal divider in units of the fitted one's."""
    return p.divider_kohm / NOMINAL_DIVIDER_KOHM


def _sensor_gains(p: WorldParameters, seed: int, shape: Shape) -> _Floats:
    """Return each taxel's gain: its layer's, times the sensor's spread and the session's change."""
    layer = np.repeat(of_layers(p.top_gain, p.bottom_gain, shape), shape[0] * shape[1])
    own = random_generator(SENSOR_SERIAL, NoiseStream.SENSOR).standard_normal(layer.size)
    session = random_generator(seed, NoiseStream.SESSION).standard_normal(layer.size)
    gains: _Floats = _divider(p) * layer * np.exp(p.gain_spread * own + p.session_spread * session)
    return gains
