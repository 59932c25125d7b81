"""What a plate does to a skin that is pressed on it: tables over place and depth.

The skin touches ridges first, bridges grooves, and its pressure grows as a power of how deep it
is pressed. Each mounting of a plate has a seat of its own.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.noise import Stream, generator
from rigctl.simulation.bench.numba_options import compiled
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.bench.textures import (
    GRID_MM,
    Texture,
    blurred,
    cells_of,
    gauss,
    hann,
    plate_profile,
    texture,
)
from rigctl.values import N_TAXELS

N_PLACES = 9
"""Places of the sensor; a taxel of each layer lies at each of them."""

N_TOP = N_PLACES
DEPTH_CELLS = 96
REFERENCE_G = 500.0
"""Force at which a smooth plate shows the stiffness it is described by, and for which the clamp
is as high as carries like the plate."""

UNIT_G = 250.0
"""Force whose mean pressure is one, where gains and saturation are told."""

DEEPEST_G = 2500.0
"""Tables reach to the depth of this force on a whole plate; behind them they go on as lines."""

_Floats = NDArray[np.float64]
_Table = NDArray[np.float32]


class ContactTables(NamedTuple):
    """One plate around the drum. Depths count from the highest ridge, ``cell_mm`` apart.

    ``load``: float32 (depths, places), force in g on the whole sensor were each of it pressed
    like the patch of one taxel here. ``felt``: float32 (depths, places, 2), conductance over its
    gain of a top and a bottom taxel here; ``mean``: float32 (depths, 2), its mean over the plate.
    """

    load: _Table
    felt: _Table
    mean: _Table
    cell_mm: float


class Footprint(NamedTuple):
    """Force of the whole sensor in g over travel from first touch, ``cell_mm`` apart, and place.

    ``force_g``: float32 (depths, places). ``give_mm_g``: how far the frame gives way.
    """

    force_g: _Table
    cell_mm: float
    give_mm_g: float

    def travel_mm(self, force_g: float) -> float:
        """Travel at which the plate carries a force in the mean over its places."""
        means = self.force_g.mean(axis=1, dtype=np.float64)
        return float(np.interp(force_g, means, np.arange(means.size) * self.cell_mm))


class Mounting(NamedTuple):
    """How a plate sits: along and across in mm a taxel pitch, shift in mm, gains float64 (18,)."""

    tilt_along_mm: float
    tilt_across_mm: float
    seating_mm: float
    gains: _Floats


def mounted(parameters: WorldParameters, seed: int, number: int) -> Mounting:
    """The seat that mounting ``number`` of a session gets; it stays until the next one."""
    random = generator(seed, Stream.SEATING, number)
    shift_mm = parameters.plate_seating_mm * random.uniform(-1.0, 1.0)
    along_mm, across_mm = parameters.plate_tilt_mm * random.standard_normal(2)
    gains = np.exp(parameters.mounting_spread * random.standard_normal(N_TAXELS))
    return Mounting(float(along_mm), float(across_mm), float(shift_mm), gains)


def places_along(parameters: WorldParameters, mounting: Mounting) -> _Floats:
    """Where each place of the sensor lies on the plate, mm from its middle, float64 (9,)."""
    row, column = _rows_and_columns()
    skew = math.tan(math.radians(parameters.sensor_skew_deg))
    return parameters.taxel_pitch_mm * (row + column * skew) + mounting.seating_mm


def missed(parameters: WorldParameters, mounting: Mounting) -> _Floats:
    """Depth that each place misses, mm over that of the deepest, float64 (9,)."""
    row, column = _rows_and_columns()
    edge_mm = parameters.edge_drop_mm * row**2
    tilted = edge_mm + mounting.tilt_along_mm * row + mounting.tilt_across_mm * column
    over: _Floats = tilted - tilted.min()
    return over


def footprint(tables: ContactTables, parameters: WorldParameters, mounting: Mounting) -> Footprint:
    """Contact force of a plate that sits so, the frame's give included."""
    depths = np.arange(DEPTH_CELLS, dtype=np.float64)
    total = np.zeros_like(tables.load)
    shifts = np.rint(places_along(parameters, mounting) / GRID_MM).astype(int)
    for shift, miss_mm in zip(shifts, missed(parameters, mounting), strict=True):
        deep = np.maximum(depths - miss_mm / tables.cell_mm, 0.0)
        low = np.minimum(deep.astype(int), DEPTH_CELLS - 2)
        share = (deep - low).astype(np.float32)[:, None]
        patch = tables.load[low] * (1 - share) + tables.load[low + 1] * share
        total += np.roll(patch, -shift, axis=1)
    total /= N_PLACES
    give = parameters.frame_share / parameters.stiffness_g_mm
    travel_mm = (DEPTH_CELLS - 1) * tables.cell_mm + DEEPEST_G * give
    cell_mm = travel_mm / (DEPTH_CELLS - 1)
    return Footprint(_over_travel(total, tables.cell_mm, give, cell_mm), cell_mm, give)


@compiled
def _over_travel(
    force_g: _Table, depth_cell_mm: float, give_mm_g: float, travel_cell_mm: float
) -> _Table:
    """Force over depth as force over depth and give, float32 (depths, places) both."""
    depths, places = force_g.shape
    out = np.zeros_like(force_g)
    for place in range(places):
        deep = 0
        for row in range(depths):
            travel = row * travel_cell_mm
            while deep < depths - 2:
                force = force_g[deep + 1, place]
                if (deep + 1) * depth_cell_mm + force * give_mm_g > travel:
                    break
                deep += 1
            low, high = force_g[deep, place], force_g[deep + 1, place]
            step = depth_cell_mm + (high - low) * give_mm_g
            share = (travel - deep * depth_cell_mm - low * give_mm_g) / step
            out[row, place] = low + share * (high - low)
    return out


@lru_cache(maxsize=4)
def contact_tables(name: str, parameters: WorldParameters) -> ContactTables:
    """The tables of one plate. Raises WrongUse for a name that is not ``A``–``P``."""
    heights = _surface(texture(name, parameters), parameters)
    cell_mm = _depth_of(DEEPEST_G, heights, parameters) / (DEPTH_CELLS - 1)
    depths_mm = np.arange(DEPTH_CELLS, dtype=np.float32) * np.float32(cell_mm)
    pressed = np.maximum(heights.astype(np.float32) + depths_mm[:, None], 0)
    pressure = pressed ** np.float32(parameters.pressure_power)
    pressure *= np.float32(pressure_g(parameters))
    below = gauss(parameters.bottom_blur_mm)
    load = blurred(pressure, np.ones(cells_of(parameters.taxel_pitch_mm)), below)
    felt = np.empty((DEPTH_CELLS, heights.size, 2), np.float32)
    taxel = hann(parameters.taxel_size_mm)
    for layer, blur_mm in enumerate((parameters.top_blur_mm, parameters.bottom_blur_mm)):
        felt[:, :, layer] = _conductance(blurred(pressure, taxel, gauss(blur_mm)), parameters)
    return ContactTables(np.maximum(load, 0), felt, felt.mean(axis=1), cell_mm)


@lru_cache(maxsize=4)
def pressure_g(parameters: WorldParameters) -> float:
    """Force per mm of depth to the pressure's power, were the whole sensor pressed alike.

    The sensor as it is shows the skin's stiffness on a smooth plate at :data:`REFERENCE_G`.
    """
    power = parameters.pressure_power
    skin_g_mm = parameters.stiffness_g_mm / (1.0 - parameters.frame_share)
    row, _ = _rows_and_columns()
    low, high = 0.0, 2.0 * power * REFERENCE_G / skin_g_mm + parameters.edge_drop_mm
    for _ in range(50):
        deep = 0.5 * (low + high)
        pressed = np.maximum(deep - parameters.edge_drop_mm * row**2, 0.0)
        force_g = skin_g_mm * np.mean(pressed**power) / (power * np.mean(pressed ** (power - 1.0)))
        low, high = (deep, high) if force_g < REFERENCE_G else (low, deep)
    return float(REFERENCE_G / np.mean(pressed**power))


def _conductance(pressure: _Table, p: WorldParameters) -> _Table:
    """Conductance over its gain: a power of the pressure, bent where the fabric saturates."""
    power = np.float32(p.conductance_power)
    rising = np.maximum(pressure / np.float32(UNIT_G), 0) ** power
    bend = np.float32((UNIT_G / p.saturation_g) ** p.conductance_power)
    conductance: _Table = rising / (1 + rising * bend)
    return conductance


def _surface(plate: Texture, parameters: WorldParameters) -> _Floats:
    """What the skin follows around the drum, mm over the highest ridge, float64 (places,)."""
    printed, on_plate = plate_profile(plate, parameters)
    followed = blurred(printed, gauss(parameters.bridging_mm))
    followed -= followed[on_plate].max()
    # A clamp that carries like the plate lets the drum roll over it without a blow.
    deep_mm = _depth_of(REFERENCE_G, followed[on_plate], parameters)
    clamp_mm = (REFERENCE_G / pressure_g(parameters)) ** (1.0 / parameters.pressure_power) - deep_mm
    followed[~on_plate] = clamp_mm
    return followed


def _depth_of(force_g: float, heights: _Floats, parameters: WorldParameters) -> float:
    """Depth at which a whole surface of these heights carries a force, mm."""
    spread = np.quantile(heights, np.linspace(0.0, 1.0, 501))
    wanted = force_g / pressure_g(parameters)
    low = 0.0
    high = wanted ** (1.0 / parameters.pressure_power) - float(heights.min())
    for _ in range(40):
        deep = 0.5 * (low + high)
        carried = np.mean(np.maximum(spread + deep, 0.0) ** parameters.pressure_power)
        low, high = (deep, high) if carried < wanted else (low, deep)
    return float(high)


def _rows_and_columns() -> tuple[_Floats, _Floats]:
    """Row along the travel and column across it of each place, counted from the middle."""
    place = np.arange(N_PLACES, dtype=np.float64)
    return place // 3 - 1.0, place % 3 - 1.0
