"""Contact between plate and skin: tables of force and conductance over position and depth.

The skin touches ridges first, bridges grooves, and its pressure grows as a power of the depth.
Each mounting of a plate draws its own alignment.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.noise import NoiseStream, random_generator
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import (
    GRID_MM,
    Texture,
    Values,
    blur_circular,
    drum_heights,
    find_texture,
    gaussian_window,
    hann_window,
    odd_cell_count,
)
from rigctl.config.rig_config import PAPER_ARRAY
from rigctl.kernels import compiled

Shape = tuple[int, int, int]
"""Rows along the travel and columns across it, the sites of a sensor, and layers: each site holds a
taxel of each layer."""

N_DEPTHS = 96
REFERENCE_FORCE_G = 500.0
"""A smooth plate has its nominal stiffness, and the clamp the plate's depth, at this force."""

UNIT_FORCE_G = 250.0
"""Force whose mean pressure is 1; gains and saturation refer to it."""

MAX_FORCE_G = 2500.0
"""The tables end at the depth of this force on a whole plate; beyond, they extrapolate linearly."""

_Floats = NDArray[np.float64]
_Table = NDArray[np.float32]


class ContactTables(NamedTuple):
    """One plate around the drum. Depths count from the highest ridge, ``cell_mm`` apart.

    ``patch_force_g``: float32 (depths, positions), force on the whole sensor if every taxel's patch
    were pressed like the one here. ``conductance``: float32 (depths, positions, layers),
    conductance of a taxel of each layer here, divided by its gain; ``mean_conductance``: float32
    (depths, layers), its mean over all positions. ``shape``: that of the sensor.
    """

    patch_force_g: _Table
    conductance: _Table
    mean_conductance: _Table
    cell_mm: float
    shape: Shape


class ForceTable(NamedTuple):
    """Contact force over travel from first touch (``cell_mm`` apart) and position on the drum.

    ``force_g``: float32 (travels, positions). ``frame_mm_g``: compliance of the frame.
    """

    force_g: _Table
    cell_mm: float
    frame_mm_g: float

    def travel_mm(self, force_g: float) -> float:
        """Return the travel at which the mean force over all positions reaches ``force_g``."""
        means = self.force_g.mean(axis=1, dtype=np.float64)
        return float(np.interp(force_g, means, np.arange(means.size) * self.cell_mm))


class Mounting(NamedTuple):
    """Alignment of a mounted plate: tilts in mm a taxel pitch, shift along, gains float64
    (n_taxels,), and a turn of the sensor against the travel besides that of the world.

    ``give_…_mm_g``: what a gram of contact force adds to each tilt.
    """

    tilt_along_mm: float
    tilt_across_mm: float
    shift_mm: float
    gains: _Floats
    turn_deg: float = 0.0
    give_along_mm_g: float = 0.0
    give_across_mm_g: float = 0.0


def draw_mounting(
    parameters: WorldParameters, seed: int, number: int, n_taxels: int = PAPER_ARRAY.count
) -> Mounting:
    """Return the alignment of mounting ``number`` of a session."""
    random = random_generator(seed, NoiseStream.SEATING, number)
    shift_mm = parameters.plate_seating_mm * random.uniform(-1.0, 1.0)
    along_mm, across_mm = parameters.plate_tilt_mm * random.standard_normal(2)
    gains = np.exp(parameters.mounting_spread * random.standard_normal(n_taxels))
    gives_mm_g = parameters.plate_give_mm / REFERENCE_FORCE_G * random.standard_normal(2)
    tilts = float(along_mm), float(across_mm)
    return Mounting(*tilts, float(shift_mm), gains, 0.0, *gives_mm_g.tolist())


def positions_along_mm(parameters: WorldParameters, mounting: Mounting, shape: Shape) -> _Floats:
    """Return the position of each site along the travel, mm from the middle, float64 (sites,)."""
    return _along_mm(parameters, mounting, *_rows_and_columns(shape))


def _along_mm(p: WorldParameters, mounting: Mounting, row: _Floats, column: _Floats) -> _Floats:
    skew = math.tan(math.radians(p.sensor_skew_deg + mounting.turn_deg))
    return p.taxel_pitch_mm * (row + column * skew) + mounting.shift_mm


def depth_offsets_mm(parameters: WorldParameters, mounting: Mounting, shape: Shape) -> _Floats:
    """Return how much less deep than the deepest site each site is, mm, float64 (sites,)."""
    drops_mm = _drops_mm(parameters, mounting, *_rows_and_columns(shape))
    offsets: _Floats = drops_mm - drops_mm.min()
    return offsets


def gives_mm_g(mounting: Mounting, shape: Shape) -> _Floats:
    """Return how much less deep each site is for a gram of contact force, float64 (sites,)."""
    row, column = _rows_and_columns(shape)
    return mounting.give_along_mm_g * row + mounting.give_across_mm_g * column


def _drops_mm(p: WorldParameters, mounting: Mounting, row: _Floats, column: _Floats) -> _Floats:
    """Return how much less deep than a drum's crest patches are, mm."""
    edge_mm = p.edge_drop_mm * row**2
    across_mm = p.sensor_tilt_mm + mounting.tilt_across_mm
    return edge_mm + mounting.tilt_along_mm * row + across_mm * column


def force_table(
    tables: ContactTables, parameters: WorldParameters, mounting: Mounting
) -> ForceTable:
    """Return the contact force of a mounted plate, the frame's compliance included."""
    total = np.zeros_like(tables.patch_force_g)
    row, column, share_of_patch = _patches(parameters, tables.shape)
    shifts = np.rint(_along_mm(parameters, mounting, row, column) / GRID_MM).astype(int)
    drops_mm = _drops_mm(parameters, mounting, row, column)
    n_sites = tables.shape[0] * tables.shape[1]
    offsets_mm = drops_mm - drops_mm[:n_sites].min()
    shares = share_of_patch.astype(np.float32)
    _add_patches(total, tables.patch_force_g, shifts, offsets_mm / tables.cell_mm, shares)
    total /= n_sites
    frame_mm_g = parameters.frame_share / parameters.stiffness_g_mm
    travel_mm = (N_DEPTHS - 1) * tables.cell_mm + MAX_FORCE_G * frame_mm_g
    cell_mm = travel_mm / (N_DEPTHS - 1)
    over_travel = _resample_over_travel(total, tables.cell_mm, frame_mm_g, cell_mm)
    return ForceTable(over_travel, cell_mm, frame_mm_g)


@compiled
def _add_patches(
    total_g: _Table,
    patch_force_g: _Table,
    shifts: NDArray[np.int64],
    offsets: _Floats,
    shares: NDArray[np.float32],
) -> None:
    """Add the forces of all patches, each deeper by ``offsets`` rows and ``shifts`` columns on."""
    depths, positions = total_g.shape
    for depth in range(depths):
        total = total_g[depth]
        for patch in range(shifts.size):
            deep = max(depth - offsets[patch], 0.0)
            low = min(int(deep), depths - 2)
            upper = np.float32(deep - low)
            lower, part = np.float32(1.0) - upper, shares[patch]
            first_column = shifts[patch] % positions
            seam = positions - first_column
            for begin, first, count in ((0, first_column, seam), (seam, 0, first_column)):
                sums = total[begin : begin + count]
                near = patch_force_g[low, first : first + count]
                far = patch_force_g[low + 1, first : first + count]
                for i in range(count):
                    sums[i] += part * (near[i] * lower + far[i] * upper)


@compiled
def _resample_over_travel(
    force_g: _Table, depth_cell_mm: float, frame_mm_g: float, travel_cell_mm: float
) -> _Table:
    """Return force over travel (depth and the frame's deflection) from force over depth.

    Both are float32 (depths, positions).
    """
    depths, positions = force_g.shape
    out = np.zeros_like(force_g)
    for position in range(positions):
        deep = 0
        for row in range(depths):
            travel = row * travel_cell_mm
            while deep < depths - 2:
                force = force_g[deep + 1, position]
                if (deep + 1) * depth_cell_mm + force * frame_mm_g > travel:
                    break
                deep += 1
            low, high = force_g[deep, position], force_g[deep + 1, position]
            step = depth_cell_mm + (high - low) * frame_mm_g
            share = (travel - deep * depth_cell_mm - low * frame_mm_g) / step
            out[row, position] = low + share * (high - low)
    return out


@lru_cache(maxsize=4)
def contact_tables(
    name: str, parameters: WorldParameters, shape: Shape = PAPER_ARRAY.shape
) -> ContactTables:
    """Return the tables of one plate. Raises WrongUse for a name that is not ``A``–``P``."""
    heights = _skin_profile(find_texture(name, parameters), parameters, shape)
    cell_mm = _depth_at_force(MAX_FORCE_G, heights, parameters, shape) / (N_DEPTHS - 1)
    depths_mm = np.arange(N_DEPTHS, dtype=np.float32) * np.float32(cell_mm)
    pressed = np.maximum(heights.astype(np.float32) + depths_mm[:, None], 0)
    scale_g = np.float32(pressure_scale_g(parameters, shape))
    pressure = scale_g * pressed ** np.float32(parameters.pressure_power)
    below = gaussian_window(parameters.bottom_blur_mm)
    patch_mm, taxel_mm = parameters.taxel_pitch_mm, parameters.taxel_size_mm
    patch = blur_circular(pressure, np.ones(odd_cell_count(patch_mm)), below)
    if parameters.taxel_rise_mm:
        lower = scale_g * _lowered(pressed, parameters) ** np.float32(parameters.pressure_power)
        patch = blur_circular(lower, np.ones(odd_cell_count(patch_mm)), below)
        raised = blur_circular(pressure - lower, np.ones(odd_cell_count(taxel_mm)), below)
        patch += np.float32(_taxel_share(parameters)) * raised
    blurs_mm = of_layers(parameters.top_blur_mm, parameters.bottom_blur_mm, shape)
    conductance = np.empty((N_DEPTHS, heights.size, len(blurs_mm)), np.float32)
    taxel = hann_window(taxel_mm)
    for layer, blur_mm in enumerate(blurs_mm):
        blurred = blur_circular(pressure, taxel, gaussian_window(blur_mm))
        conductance[:, :, layer] = _conductance(blurred, parameters)
    mean = conductance.mean(axis=1)
    return ContactTables(np.maximum(patch, 0), conductance, mean, cell_mm, shape)


def of_layers(top: float, bottom: float, shape: Shape) -> list[float]:
    """Return a value for each layer: that of the top, that of the bottom, between them in steps."""
    n_layers = shape[2]
    shares = [layer / max(n_layers - 1, 1) for layer in range(n_layers)]
    return [top * (1.0 - share) + bottom * share for share in shares]


@lru_cache(maxsize=4)
def pressure_scale_g(parameters: WorldParameters, shape: Shape) -> float:
    """Return force per mm of depth to the pressure's power, if all sites had the same depth.

    With it, the sensor on a smooth plate has the skin's stiffness at :data:`REFERENCE_FORCE_G`.
    """
    power = parameters.pressure_power
    skin_g_mm = parameters.stiffness_g_mm / (1.0 - parameters.frame_share)
    row, _, part = _patches(parameters, shape)
    n_sites = shape[0] * shape[1]

    def carried(power: float) -> float:
        return float(np.sum(part * _carried(pressed, power, parameters)) / n_sites)

    low = 0.0
    high = 2.0 * power * REFERENCE_FORCE_G / skin_g_mm
    high += parameters.edge_drop_mm + parameters.taxel_rise_mm
    for _ in range(50):
        deep = 0.5 * (low + high)
        pressed = np.maximum(deep - parameters.edge_drop_mm * row**2, 0.0)
        force_g = skin_g_mm * carried(power) / (power * carried(power - 1.0))
        low, high = (deep, high) if force_g < REFERENCE_FORCE_G else (low, deep)
    return float(REFERENCE_FORCE_G / carried(power))


def _lowered(pressed: Values, p: WorldParameters) -> Values:
    """Return the depths between the taxels, which stand out of the skin."""
    lowered: Values = np.maximum(pressed - pressed.dtype.type(p.taxel_rise_mm), 0)
    return lowered


def _taxel_share(p: WorldParameters) -> float:
    """Return the share of a patch that its taxel takes."""
    return float((p.taxel_size_mm / p.taxel_pitch_mm) ** 2)


def _carried(pressed: _Floats, power: float, p: WorldParameters) -> _Floats:
    """Return the mean over a patch of the depth to a power."""
    on_taxels = pressed**power
    if not p.taxel_rise_mm:
        return on_taxels
    between = _lowered(pressed, p) ** power
    return between + _taxel_share(p) * (on_taxels - between)


def _conductance(pressure: _Table, p: WorldParameters) -> _Table:
    """Return conductance over gain: a power of the pressure that saturates."""
    power = np.float32(p.conductance_power)
    unsaturated = np.maximum(pressure / np.float32(UNIT_FORCE_G), 0) ** power
    bend = np.float32((UNIT_FORCE_G / p.saturation_g) ** p.conductance_power)
    conductance: _Table = unsaturated / (1 + unsaturated * bend)
    return conductance


def _skin_profile(plate: Texture, parameters: WorldParameters, shape: Shape) -> _Floats:
    """Return the surface that the skin follows, mm over the highest ridge, float64 (positions,)."""
    printed, on_plate = drum_heights(plate, parameters)
    followed = blur_circular(printed, gaussian_window(parameters.bridging_mm))
    followed -= followed[on_plate].max()
    # A clamp that carries the same force as the plate lets the drum roll over it without a shock.
    surfaces = np.zeros(1), followed[on_plate]
    clamp_mm, plate_mm = (
        _depth_at_force(REFERENCE_FORCE_G, surface, parameters, shape) for surface in surfaces
    )
    followed[~on_plate] = clamp_mm - plate_mm
    return followed


def _depth_at_force(
    force_g: float, heights: _Floats, parameters: WorldParameters, shape: Shape
) -> float:
    """Return the depth at which a whole surface of these heights carries a force, mm."""
    spread = np.quantile(heights, np.linspace(0.0, 1.0, 501))
    target = force_g / pressure_scale_g(parameters, shape)
    low = 0.0
    high = target ** (1.0 / parameters.pressure_power) - float(heights.min())
    high += parameters.taxel_rise_mm
    for _ in range(40):
        deep = 0.5 * (low + high)
        pressed = np.maximum(spread + deep, 0.0)
        mean = np.mean(_carried(pressed, parameters.pressure_power, parameters))
        low, high = (deep, high) if mean < target else (low, deep)
    return float(high)


def _patches(parameters: WorldParameters, shape: Shape) -> tuple[_Floats, _Floats, _Floats]:
    """Return row, column and share of each patch that carries force: the sites first.

    Before and behind the array, along the travel, the skin goes on to its ends.
    """
    row, column = _rows_and_columns(shape)
    rows, columns, _ = shape
    beyond = max(0.0, 0.5 * (parameters.skin_length_mm / parameters.taxel_pitch_mm - rows))
    steps = np.arange(1.0, math.ceil(beyond) + 1.0)
    outer = np.repeat(0.5 * (rows - 1) + steps, columns)
    share = np.repeat(np.minimum(1.0, beyond + 1.0 - steps), columns)
    across = np.tile(column[:columns], steps.size)
    return (
        np.concatenate([row, outer, -outer]),
        np.concatenate([column, across, across]),
        np.concatenate([np.ones_like(row), share, share]),
    )


def _rows_and_columns(shape: Shape) -> tuple[_Floats, _Floats]:
    """Return each site's row along and column across the travel, counted from the middle."""
    rows, columns, _ = shape
    site = np.arange(rows * columns, dtype=np.float64)
    return site // columns - 0.5 * (rows - 1), site % columns - 0.5 * (columns - 1)
