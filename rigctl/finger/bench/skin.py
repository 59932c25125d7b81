"""The bench's skin on a finger: readings of the 18 taxels while it moves over flat plates."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.contact import (
    ContactTables,
    ForceTable,
    Mounting,
    contact_tables,
    force_table,
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
from rigctl.bench.parameters import WorldParameters, validated
from rigctl.bench.skin import SLOT_US, Skin
from rigctl.finger.board_messages import N_TAXELS
from rigctl.finger.values import PLATE_MM
from rigctl.kernels import compiled
from rigctl.values import DRAWN_WIRING

TABLE_MM = 400.0
"""Length of the tables of plate and clamp; a flat plate ends where a drum's clamp would begin."""

TOP_LAYER = np.array(DRAWN_WIRING[:N_TAXELS])
"""The readings that are the finger's nine taxels, row by row."""

MOST_MS = RING_MS // 2
MS_PER_SLIDE = 1 << 24
"""Noise counts milliseconds from here for each slide, so that it depends on the slide's number."""
CONTACTS_PER_SLIDE = 1 << 10
_Floats = NDArray[np.float64]


class _Motion:
    """The finger in the place of the bench's mechanics: what the skin reads of them."""

    def __init__(self) -> None:
        self.time_ms = 0
        self.contacts = 0
        self.log = np.zeros((RING_MS, 5))

    def append(self, along_mm: _Floats, force_g: _Floats, forces: ForceTable) -> None:
        """Add milliseconds: place on the table and force, float64 (n,) each."""
        self.contacts = _log_motion(
            self.log,
            self.time_ms,
            self.contacts,
            along_mm,
            force_g,
            forces.force_g,
            forces.cell_mm,
            forces.frame_mm_g,
        )
        self.time_ms += len(force_g)


class FingerSkin:
    """The sensor on a finger, for one session.

    ``rest``: conductance without load, relative to the world's. Raises WrongUse for a parameter
    outside its plausible range.
    """

    def __init__(self, parameters: WorldParameters, seed: int, rest: float = 1.0) -> None:
        # A plate is flat, so no row of taxels stands off as on the drum's curve, a finger turns
        # until its sensor lies on the plate, and its tip is no longer than the array.
        self._p = replace(
            validated(parameters),
            circumference_mm=TABLE_MM,
            plate_length_mm=PLATE_MM,
            edge_drop_mm=0.0,
            sensor_tilt_mm=0.0,
            skin_length_mm=15.0,
            rest_conductance=parameters.rest_conductance * rest,
        )
        self._motion = _Motion()
        self._skin = Skin(self._p, seed, cast("Mechanics", self._motion))
        self._plates: dict[str, ContactTables] = {}
        self._forces = ForceTable(np.zeros((2, 1), np.float32), 0.0, 0.0)

    def begin_slide(self, number: int, plate: str, mounting: Mounting) -> None:
        """Lay out a plate for slide ``number``. Raises WrongUse for an unknown plate."""
        if plate not in self._plates:
            self._plates[plate] = contact_tables(plate, self._p)
        tables = self._plates[plate]
        self._skin.set_plate(tables, mounting)
        self._forces = force_table(tables, self._p, mounting)
        self._jump((number + 1) * MS_PER_SLIDE)
        self._motion.contacts = (number + 1) * CONTACTS_PER_SLIDE

    def advance(self, along_mm: _Floats, force_g: _Floats) -> NDArray[np.uint16]:
        """Return the readings of the next milliseconds, in the order of the taxel board's wire.

        Takes the place on the plate in mm and the contact force in g, float64 (n,) each; returns
        uint16 (n, 18). Before the first slide there is
        no plate, and the force must be 0.
        """
        if len(along_mm) <= MOST_MS:
            return self._advance(along_mm, force_g)
        parts = range(0, len(along_mm), MOST_MS)
        return np.concatenate(
            [self._advance(along_mm[i : i + MOST_MS], force_g[i : i + MOST_MS]) for i in parts]
        )

    def _advance(self, along_mm: _Floats, force_g: _Floats) -> NDArray[np.uint16]:
        first = self._motion.time_ms
        table_mm = along_mm + self._p.plate_start_mm
        self._motion.append(table_mm, np.ascontiguousarray(force_g), self._forces)
        self._skin.advance()
        # A frame's slots lie between two rows of levels, so the newest frame ends a row earlier.
        starts_us = np.arange(first - 1, first - 1 + len(force_g), dtype=np.float64) * 1000.0
        return self._skin.read(first, starts_us, SLOT_US)

    def _jump(self, time_ms: int) -> None:
        """Continue at another time, where noise has other numbers, from the present state."""
        now = self._motion.time_ms
        for rows in (self._motion.log, self._skin.conductances):
            rows[[(time_ms - 1) % RING_MS, time_ms % RING_MS]] = rows[
                [(now - 1) % RING_MS, now % RING_MS]
            ]
        self._motion.time_ms = self._skin.time_ms = time_ms


@compiled
def _log_motion(
    log: _Floats,
    time_ms: int,
    contacts: int,
    along_mm: _Floats,
    force_g: _Floats,
    table: NDArray[np.float32],
    cell_mm: float,
    frame_mm_g: float,
) -> int:
    """Log milliseconds after ``time_ms``; return the number of contacts so far.

    The depth is the one at which the skin carries the force at that place; ``table``: float32
    (travels, positions), see :class:`ForceTable`.
    """
    last, positions = table.shape[0] - 1, table.shape[1]
    before = log[time_ms % RING_MS, FORCE_G]
    for k in range(force_g.size):
        row, force = log[(time_ms + 1 + k) % RING_MS], force_g[k]
        contacts += force > 0.0 and before <= 0.0
        column = round(along_mm[k] * CELLS_PER_MM) % positions
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if table[middle, column] >= force:
                high = middle
            else:
                low = middle
        step_g = max(table[high, column] - table[low, column], 1e-9)
        travel = low + min(max((force - table[low, column]) / step_g, 0.0), 1.0)
        row[DRUM_MM], row[FORCE_G], row[CONTACTS] = along_mm[k], force, contacts
        row[DEPTH_MM] = max(travel * cell_mm - force * frame_mm_g, 0.0) if force > 0.0 else 0.0
        before = force
    return contacts
