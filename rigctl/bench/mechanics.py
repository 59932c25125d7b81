"""Drum, actuator and contact force, simulated one millisecond at a time.

The actuator moves the drum down a screw with lag, dead band and backlash; the motor's steps set
the drum's position. Both determine the contact force. Load cell, skin and ground truth read the
last milliseconds from a ring.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.contact import REFERENCE_FORCE_G, ForceTable
from rigctl.bench.noise import modulo
from rigctl.bench.parameters import WorldParameters
from rigctl.bench.textures import GRID_MM
from rigctl.kernels import compiled, inlined

RING_MS = 4096
"""Length of the ring; no reader goes back further."""

DRUM_MM, DEPTH_MM, FORCE_G, LOADCELL_G, CONTACTS = range(5)
"""Columns of the ring: drum position, depth, contact force and force on the load cell at the end
of the millisecond, and the number of contacts since power-up."""

# Plain arrays with named indices: passing a record to compiled code costs 5 µs a call.
TIME_MS, _POSITION, _SLIP, _VELOCITY, ROD, _DEPTH = range(6)
FORCE, _CONTACTS, _TOUCHING, _JAMMED, _PUSH, _SPEED, _STATE_SIZE = range(6, 13)
"""Indices of the state ``s``."""

_C_TURN, _C_FACTOR, _C_START, _C_RUN_OUT, _C_PHASE = range(5)
ACTUATOR_SPEED, _C_GAIN, _C_DEAD, _C_STICTION, _C_BACKLASH, _C_WEIGHT, _C_TRAVEL = range(5, 12)
_C_CONTACT, _C_TRAVEL_CELLS, _C_FRAME, _C_IMBALANCE, _C_MASS, _C_DRAG = range(12, 18)
"""Indices of the constants ``c``."""

_Floats = NDArray[np.float64]
_Table = NDArray[np.floating[Any]]
_Rows = NDArray[np.float32]
MechanicsArrays = tuple[_Floats, _Floats, _Floats, _Table]
"""State, constants, ring and force table; compiled code passes them to :func:`step_millisecond`."""
CELLS_PER_MM = 1.0 / GRID_MM
_SPEED_GAIN = 1.0 - math.exp(-1.0 / 20.0)
"""Drag follows the speed in 20 ms, assumed: the skin shears first, and a step is no speed."""
DRAG_FREE_MM_S = 60.0
"""Where a turning drum's cell reads the contact force; another speed asks for another stiffness."""


class DrumTrajectory(NamedTuple):
    """Commanded travel of the drum: ``travel_mm + speed_mm_s·t``, where t starts at ``from_us``."""

    from_us: float
    travel_mm: float
    speed_mm_s: float


@inlined
def _interpolate_force(
    force_g: _Table, low: int, high: int, share: float, travel_mm: float, c: _Floats
) -> float:
    """Return the contact force between two positions; beyond the last row it is linear."""
    cell = travel_mm * c[_C_TRAVEL_CELLS]
    if cell <= 0.0:
        return 0.0
    row = min(int(cell), force_g.shape[0] - 2)
    more = cell - row
    above = force_g[row, low] * (1.0 - share) + force_g[row, high] * share
    below = force_g[row + 1, low] * (1.0 - share) + force_g[row + 1, high] * share
    return float(above * (1.0 - more) + below * more)


@inlined
def _move_actuator(s: _Floats, c: _Floats, drive: float) -> float:
    """Move the rod for one millisecond and return its change of speed, mm/s."""
    still = abs(s[_VELOCITY]) < 0.01
    threshold = c[_C_DEAD] + (c[_C_STICTION] if still else 0.0)
    target = 0.0
    if abs(drive) > threshold:
        share = (abs(drive) - c[_C_DEAD]) / (1.0 - c[_C_DEAD])
        target = math.copysign(share * c[ACTUATOR_SPEED], drive)
    before = s[_VELOCITY]
    s[_VELOCITY] += (target - before) * c[_C_GAIN]
    s[ROD] += s[_VELOCITY] * 1e-3
    if s[ROD] <= 0.0 or s[ROD] >= c[_C_TRAVEL]:
        s[ROD] = min(max(s[ROD], 0.0), c[_C_TRAVEL])
        s[_VELOCITY] = 0.0
    return float(s[_VELOCITY] - before)


@inlined
def _press_skin(s: _Floats, c: _Floats, force_table: _Table, gap_mm: float) -> None:
    """Compute depth and force; ``gap_mm`` is the distance from drum to skin with the rod at 0.

    The drum's weight holds the screw's backlash on its lower flank; a contact force above the
    weight pushes it to the upper flank.
    """
    travel = s[ROD] + 0.5 * c[_C_BACKLASH] - gap_mm
    s[_DEPTH] = travel
    s[FORCE] = 0.0
    if travel <= 0.0:
        return
    cell = modulo(s[_POSITION], c[_C_TURN]) * CELLS_PER_MM
    low = int(cell)
    share = cell - low
    size = force_table.shape[1]
    low = low - size if low >= size else low
    high = low + 1 if low + 1 < size else 0
    force = _interpolate_force(force_table, low, high, share, travel, c)
    if force > c[_C_WEIGHT]:
        travel -= c[_C_BACKLASH]
        force = max(c[_C_WEIGHT], _interpolate_force(force_table, low, high, share, travel, c))
    s[FORCE] = force
    s[_DEPTH] = travel - force * c[_C_FRAME]


@inlined
def _turn_drum(s: _Floats, c: _Floats, nominal_mm: float) -> None:
    """Turn the drum to its commanded travel, unless it is jammed."""
    position = c[_C_START] + nominal_mm * c[_C_FACTOR] - s[_SLIP]
    if s[_JAMMED]:
        s[_SLIP] += position - s[_POSITION]
    else:
        s[_POSITION] = position


@inlined
def drag_speed_mm_s(speed_mm_s: float) -> float:
    """Return the speed by which the drag counts, mm/s: none at rest and at 60 mm/s.

    The cell reads less than the contact force below, most at 40 mm/s, and more above.
    """
    return max(speed_mm_s - DRAG_FREE_MM_S, -0.5 * speed_mm_s)


@inlined
def _load_cell_force(
    s: _Floats, c: _Floats, force_table: _Table, drive: float, turned_mm: float
) -> float:
    """Move the actuator, update the contact force and return the force on the load cell."""
    angle = 2.0 * math.pi * s[_POSITION] / c[_C_TURN]
    change = _move_actuator(s, c, drive)
    run_out = c[_C_RUN_OUT] * math.sin(angle + c[_C_PHASE])
    _press_skin(s, c, force_table, c[_C_CONTACT] - run_out)
    touching = s[FORCE] > 0.0
    if touching and not s[_TOUCHING]:
        s[_CONTACTS] += 1
    s[_TOUCHING] = touching
    # Acceleration in mm/s per ms is m/s²; over 9.81 it is a share of weight.
    inertia = c[_C_MASS] * change / 9.81
    s[_SPEED] += (1000.0 * abs(turned_mm) - s[_SPEED]) * _SPEED_GAIN
    drag = c[_C_DRAG] * drag_speed_mm_s(s[_SPEED]) / 100.0
    read = s[FORCE] * (1.0 + drag * s[FORCE] / REFERENCE_FORCE_G)
    return float(read + s[_PUSH] + inertia + c[_C_IMBALANCE] * math.sin(angle))


@inlined
def step_millisecond(
    s: _Floats, c: _Floats, log: _Floats, force_table: _Table, nominal_mm: float, drive: float
) -> None:
    """Simulate the millisecond that begins now; it ends at the drum travel ``nominal_mm``."""
    s[TIME_MS] += 1
    before_mm = s[_POSITION]
    _turn_drum(s, c, nominal_mm)
    loadcell_g = _load_cell_force(s, c, force_table, drive, s[_POSITION] - before_mm)
    at = int(s[TIME_MS]) % RING_MS
    log[at, DRUM_MM] = s[_POSITION]
    log[at, DEPTH_MM] = s[_DEPTH]
    log[at, FORCE_G] = s[FORCE]
    log[at, LOADCELL_G] = loadcell_g
    log[at, CONTACTS] = s[_CONTACTS]


@compiled
def _advance(
    plant: MechanicsArrays,
    from_us: float,
    travel_mm: float,
    speed_mm_s: float,
    drive: float,
    until_ms: int,
) -> None:
    s, c, log, force_table = plant
    while s[TIME_MS] < until_ms:
        end_us = (s[TIME_MS] + 1.0) * 1000.0
        nominal_mm = travel_mm + speed_mm_s * (end_us - from_us) * 1e-6
        step_millisecond(s, c, log, force_table, nominal_mm, drive)


@compiled
def _read_motion(log: _Floats, first_ms: int, speed_mm_s: _Rows, force_g: _Rows) -> None:
    """Read the mean speed of each millisecond from ``first_ms`` on, and the force at its end."""
    for row in range(force_g.size):
        before, at = (first_ms + row) % RING_MS, (first_ms + row + 1) % RING_MS
        speed_mm_s[row] = (log[at, DRUM_MM] - log[before, DRUM_MM]) * 1e3
        force_g[row] = log[at, FORCE_G]


class Mechanics:
    """The mechanics of one bench.

    ``advance``, ``set_rod`` and compiled code with ``arrays`` change its state.
    """

    def __init__(self, parameters: WorldParameters) -> None:
        self.log = np.zeros((RING_MS, 5))
        self._state = np.zeros(_STATE_SIZE)
        self.constants = _constants(parameters)
        self._factor = float(self.constants[_C_FACTOR])
        cells = round(parameters.circumference_mm / GRID_MM)
        self._force_table: _Table = np.zeros((2, cells), np.float32)
        self._state[ROD] = parameters.actuator_start_mm
        self._state[_POSITION] = parameters.start_mm
        self.log[:, DRUM_MM] = parameters.start_mm
        self.log[:, DEPTH_MM] = parameters.actuator_start_mm - parameters.contact_mm

    def advance(self, until_ms: int, drive: float, trajectory: DrumTrajectory) -> None:
        """Run with a constant drive (duty −1 … 1, positive presses) and a drum trajectory."""
        # Floats only: another type would make numba compile the kernel again during a run.
        _advance(self.arrays, *trajectory, drive, until_ms)

    def motion_since(self, first_ms: int) -> tuple[_Rows, _Rows]:
        """Return speed of the surface and contact force in each millisecond from a time on.

        float32 (n,) each: mm/s in the mean, and g at the end; at most ``RING_MS`` ago.
        """
        speed_mm_s, force_g = np.empty((2, self.time_ms - first_ms), np.float32)
        _read_motion(self.log, first_ms, speed_mm_s, force_g)
        return speed_mm_s, force_g

    def set_rod(self, rod_mm: float) -> None:
        """Put the actuator at a travel from its upper end immediately, as no motor could."""
        self._state[ROD] = rod_mm
        self._state[_VELOCITY] = 0.0

    def set_force_table(self, table: ForceTable) -> None:
        """Use this contact force from now on."""
        self._force_table = table.force_g
        self.constants[_C_TRAVEL_CELLS] = 1.0 / table.cell_mm
        self.constants[_C_FRAME] = table.frame_mm_g

    def set_diameter(self, diameter: float) -> None:
        """Move the surface by this multiple of the travel from now on; it stays where it is."""
        factor = self._factor * diameter
        if factor == self.constants[_C_FACTOR]:
            return
        s, c = self._state, self.constants
        nominal_mm = (s[_POSITION] + s[_SLIP] - c[_C_START]) / c[_C_FACTOR]
        c[_C_FACTOR] = factor
        s[_SLIP] = c[_C_START] + nominal_mm * factor - s[_POSITION]

    def set_disturbances(self, jammed: bool, push_g: float) -> None:
        """Jam or release the drum, and press on the load cell."""
        self._state[_JAMMED] = jammed
        self._state[_PUSH] = push_g

    @property
    def arrays(self) -> MechanicsArrays:
        """Arrays for compiled code."""
        return self._state, self.constants, self.log, self._force_table

    @property
    def time_ms(self) -> int:
        return int(self._state.item(TIME_MS))

    @property
    def force_g(self) -> float:
        """True contact force."""
        return float(self._state[FORCE])

    @property
    def contacts(self) -> int:
        return int(self._state[_CONTACTS])

    @property
    def drum_mm(self) -> float:
        """True position of the drum's surface."""
        return float(self._state[_POSITION])

    @property
    def rod_mm(self) -> float:
        """True actuator travel from its upper end."""
        return float(self._state[ROD])


def _constants(p: WorldParameters) -> _Floats:
    return np.array(
        [
            p.circumference_mm,
            1.0 + p.radius_error_ppm * 1e-6,
            p.start_mm,
            p.run_out_mm,
            math.radians(p.run_out_phase_deg),
            p.actuator_speed_mm_s,
            1.0 - math.exp(-1.0 / p.actuator_lag_ms),
            p.dead_band,
            p.stiction,
            p.backlash_mm,
            p.drum_weight_g,
            p.actuator_travel_mm,
            p.contact_mm,
            0.0,
            0.0,
            p.imbalance_g,
            p.moved_mass_g,
            p.loadcell_drag,
        ]
    )
