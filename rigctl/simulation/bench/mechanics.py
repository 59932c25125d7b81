"""Drum, actuator and contact, one millisecond at a time.

The actuator moves the drum down a screw with lag, dead band and play; the drum's place comes
from the steps. What they do together is the contact force. The last milliseconds stay in a
ring from which load cell, skin and truth read.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.simulation.bench.contact import Footprint
from rigctl.simulation.bench.numba_options import around, compiled, inlined
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.bench.textures import GRID_MM

RING_MS = 4096
"""Milliseconds kept; nobody reads further back than this."""

DRUM_MM, DEPTH_MM, FORCE_G, FELT_G, CONTACTS = range(5)
"""Columns of the ring: place under the sensor, depth and contact force at the end of the
millisecond, what the load cell feels, and how many contacts there were since power-up."""

# Plain arrays with named places, because handing a record to compiled code costs 5 µs a call.
(
    TIME_MS,
    _PLACE,
    _SLIP,
    _VELOCITY,
    ROD,
    _DEPTH,
    FORCE,
    _CONTACTS,
    _TOUCHING,
    _JAMMED,
    _PUSH,
    _STATE_SIZE,
) = range(12)
_CONSTANTS = (
    "circumference_mm",
    "travel_factor",
    "start_mm",
    "run_out_mm",
    "run_out_phase",
    "actuator_speed_mm_s",
    "actuator_gain",
    "dead_band",
    "stiction",
    "backlash_mm",
    "drum_weight_g",
    "actuator_travel_mm",
    "contact_mm",
    "travel_cells_per_mm",
    "give_mm_g",
    "imbalance_g",
    "moved_mass_g",
)
(
    _C_TURN,
    _C_FACTOR,
    _C_START,
    _C_RUN_OUT,
    _C_PHASE,
    _C_SPEED,
    _C_GAIN,
    _C_DEAD,
    _C_STICTION,
    _C_BACKLASH,
    _C_WEIGHT,
    _C_TRAVEL,
    _C_CONTACT,
    _C_TRAVEL_CELLS,
    _C_GIVE,
    _C_IMBALANCE,
    _C_MASS,
) = range(len(_CONSTANTS))

_Floats = NDArray[np.float64]
_Table = NDArray[np.floating[Any]]
CELLS_PER_MM = 1.0 / GRID_MM


class RodMotion(NamedTuple):
    """Where the drum was commanded to be: ``travel_mm + speed_mm_s·t``, t from ``from_us`` on.

    All are floats: for another type the kernels would be compiled once more, in mid-run.
    """

    from_us: float
    travel_mm: float
    speed_mm_s: float


STANDING = RodMotion(0.0, 0.0, 0.0)


@inlined
def _force(
    footprint: _Table, low: int, behind: int, share: float, travel_mm: float, c: _Floats
) -> float:
    """Contact force between two places of the footprint; beyond its rows it goes on as a line."""
    cell = travel_mm * c[_C_TRAVEL_CELLS]
    if cell <= 0.0:
        return 0.0
    row = min(int(cell), footprint.shape[0] - 2)
    more = cell - row
    above = footprint[row, low] * (1.0 - share) + footprint[row, behind] * share
    below = footprint[row + 1, low] * (1.0 - share) + footprint[row + 1, behind] * share
    return float(above * (1.0 - more) + below * more)


@inlined
def _move_actuator(s: _Floats, c: _Floats, drive: float) -> float:
    """One millisecond of the rod; returns its change of speed, mm/s."""
    still = abs(s[_VELOCITY]) < 0.01
    least = c[_C_DEAD] + (c[_C_STICTION] if still else 0.0)
    target = 0.0
    if abs(drive) > least:
        share = (abs(drive) - c[_C_DEAD]) / (1.0 - c[_C_DEAD])
        target = math.copysign(share * c[_C_SPEED], drive)
    before = s[_VELOCITY]
    s[_VELOCITY] += (target - before) * c[_C_GAIN]
    s[ROD] += s[_VELOCITY] * 1e-3
    if s[ROD] <= 0.0 or s[ROD] >= c[_C_TRAVEL]:
        s[ROD] = min(max(s[ROD], 0.0), c[_C_TRAVEL])
        s[_VELOCITY] = 0.0
    return float(s[_VELOCITY] - before)


@inlined
def _touch(s: _Floats, c: _Floats, footprint: _Table, surface_mm: float) -> None:
    """Depth and force for a drum surface that stands so far from the skin at rod 0.

    The drum's weight holds the screw's play on its lower flank; a contact force above the
    weight pushes it to the upper one.
    """
    travel = s[ROD] + 0.5 * c[_C_BACKLASH] - surface_mm
    s[_DEPTH] = travel
    s[FORCE] = 0.0
    if travel <= 0.0:
        return
    cell = around(s[_PLACE], c[_C_TURN]) * CELLS_PER_MM
    low = int(cell)
    share = cell - low
    size = footprint.shape[1]
    low = low - size if low >= size else low
    behind = low + 1 if low + 1 < size else 0
    force = _force(footprint, low, behind, share, travel, c)
    if force > c[_C_WEIGHT]:
        travel -= c[_C_BACKLASH]
        force = max(c[_C_WEIGHT], _force(footprint, low, behind, share, travel, c))
    s[FORCE] = force
    s[_DEPTH] = travel - force * c[_C_GIVE]


@inlined
def _roll(s: _Floats, c: _Floats, motion: RodMotion) -> None:
    """Turn the drum to where the steps want it, unless something holds it."""
    start_us, travel, speed = motion
    nominal = travel + speed * (s[TIME_MS] * 1000.0 - start_us) * 1e-6
    place = c[_C_START] + nominal * c[_C_FACTOR] - s[_SLIP]
    if s[_JAMMED]:
        s[_SLIP] += place - s[_PLACE]
    else:
        s[_PLACE] = place


@inlined
def _press(s: _Floats, c: _Floats, footprint: _Table, drive: float) -> float:
    """Move the actuator, find the contact force; returns what the load cell feels."""
    angle = 2.0 * math.pi * s[_PLACE] / c[_C_TURN]
    change = _move_actuator(s, c, drive)
    wobble = c[_C_RUN_OUT] * math.sin(angle + c[_C_PHASE])
    _touch(s, c, footprint, c[_C_CONTACT] - wobble)
    touching = s[FORCE] > 0.0
    if touching and not s[_TOUCHING]:
        s[_CONTACTS] += 1
    s[_TOUCHING] = touching
    # Acceleration in mm/s per ms is m/s²; over 9.81 it is a share of weight.
    inertia = c[_C_MASS] * change / 9.81
    return float(s[FORCE] + s[_PUSH] + inertia + c[_C_IMBALANCE] * math.sin(angle))


@inlined
def pass_millisecond(
    s: _Floats, c: _Floats, log: _Floats, footprint: _Table, motion: RodMotion, drive: float
) -> None:
    """One millisecond of everything."""
    s[TIME_MS] += 1
    _roll(s, c, motion)
    felt = _press(s, c, footprint, drive)
    row = log[int(s[TIME_MS]) % RING_MS]
    row[DRUM_MM] = s[_PLACE]
    row[DEPTH_MM] = s[_DEPTH]
    row[FORCE_G] = s[FORCE]
    row[FELT_G] = felt
    row[CONTACTS] = s[_CONTACTS]


@compiled
def _advance(
    s: _Floats,
    c: _Floats,
    log: _Floats,
    footprint: _Table,
    motion: RodMotion,
    drive: float,
    until_ms: int,
) -> None:
    while s[TIME_MS] < until_ms:
        pass_millisecond(s, c, log, footprint, motion, drive)


class Mechanics:
    """The mechanics of one bench.

    ``advance`` and ``put_rod`` move it, and compiled code that is handed ``state``, ``constants``,
    ``log`` and ``footprint`` for :func:`pass_millisecond`; nothing else does.
    """

    def __init__(self, parameters: WorldParameters) -> None:
        self.log = np.zeros((RING_MS, 5))
        self.state = np.zeros(_STATE_SIZE)
        self.constants = _constants(parameters)
        cells = round(parameters.circumference_mm / GRID_MM)
        self.footprint = np.zeros((2, cells), np.float32)
        self.state[ROD] = parameters.actuator_start_mm
        self.state[_PLACE] = parameters.start_mm
        self.log[:, DRUM_MM] = parameters.start_mm
        self.log[:, DEPTH_MM] = parameters.actuator_start_mm - parameters.contact_mm

    def advance(self, until_ms: int, drive: float, motion: RodMotion) -> None:
        """Run with one drive (duty −1 … 1, positive presses) and one motion of the drum."""
        s, c, log = self.state, self.constants, self.log
        _advance(s, c, log, self.footprint, motion, drive, until_ms)

    def put_rod(self, rod_mm: float) -> None:
        """Stand the actuator at a travel from its upper end at once, as no motor could."""
        self.state[ROD] = rod_mm
        self.state[_VELOCITY] = 0.0

    def set_footprint(self, footprint: Footprint) -> None:
        """Contact force over travel from first touch and place, from now on."""
        self.footprint = footprint.force_g
        self.constants[_C_TRAVEL_CELLS] = 1.0 / footprint.cell_mm
        self.constants[_C_GIVE] = footprint.give_mm_g

    def disturb(self, jammed: bool, push_g: float) -> None:
        """Hold the drum, press on the load cell."""
        self.state[_JAMMED] = jammed
        self.state[_PUSH] = push_g

    @property
    def time_ms(self) -> int:
        """World time up to which the mechanics have run."""
        return int(self.state[TIME_MS])

    @property
    def drum_mm(self) -> float:
        """True place of the surface under the sensor, counted on over turns."""
        return float(self.state[_PLACE])

    @property
    def force_g(self) -> float:
        """True contact force."""
        return float(self.state[FORCE])

    @property
    def contacts(self) -> int:
        """Contacts that began since power-up."""
        return int(self.state[_CONTACTS])

    @property
    def rod_mm(self) -> float:
        """True actuator travel from its upper end."""
        return float(self.state[ROD])


def _constants(p: WorldParameters) -> _Floats:
    derived = {
        "travel_factor": 1.0 + p.radius_error_ppm * 1e-6,
        "run_out_phase": math.radians(p.run_out_phase_deg),
        "travel_cells_per_mm": 0.0,
        "give_mm_g": 0.0,
        "actuator_gain": 1.0 - math.exp(-1.0 / p.actuator_lag_ms),
    }
    return np.array([derived[n] if n in derived else getattr(p, n) for n in _CONSTANTS])
