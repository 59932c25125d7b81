"""The bench's skin on a finger: readings of the 18 taxels while it moves over flat plates."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rigctl.protocol.finger import PLATE_MM
from rigctl.simulation.bench.contact import (
    ContactTables,
    ForceTable,
    Mounting,
    contact_tables,
    force_table,
)
from rigctl.simulation.bench.mechanics import (
    CONTACTS,
    DEPTH_MM,
    DRUM_MM,
    FORCE_G,
    RING_MS,
    Mechanics,
)
from rigctl.simulation.bench.parameters import WorldParameters, validated
from rigctl.simulation.bench.skin import SLOT_US, Skin
from rigctl.simulation.bench.textures import GRID_MM
from rigctl.values import DRAWN_WIRING
from rigctl.wire.finger.messages import N_TAXELS

TABLE_MM = 400.0
"""Length of the tables of plate and clamp; a flat plate ends where a drum's clamp would begin."""

TOP_LAYER = np.array(DRAWN_WIRING[:N_TAXELS])
"""The readings that are the finger's nine taxels, row by row."""

MOST_MS = RING_MS // 2
MS_PER_SLIDE = 1 << 24
"""Noise counts milliseconds from here for each slide, so that it depends on the slide's number."""
CONTACTS_PER_SLIDE = 1 << 10


class _Motion:
    """The finger in the place of the bench's mechanics: what the skin reads of them."""

    def __init__(self) -> None:
        self.time_ms = 0
        self.contacts = 0
        self.log = np.zeros((RING_MS, 5))

    def append(
        self,
        along_mm: NDArray[np.float64],
        force_g: NDArray[np.float64],
        depth_mm: NDArray[np.float64],
    ) -> None:
        """Add milliseconds: position, force and depth, float64 (n,) each."""
        before = self.log[self.time_ms % RING_MS, FORCE_G]
        touches = (force_g > 0) & (np.concatenate([[before], force_g[:-1]]) <= 0)
        at = np.arange(self.time_ms + 1, self.time_ms + 1 + len(force_g)) % RING_MS
        self.log[at, DRUM_MM] = along_mm
        self.log[at, FORCE_G], self.log[at, DEPTH_MM] = force_g, depth_mm
        self.log[at, CONTACTS] = self.contacts + np.cumsum(touches)
        self.contacts += int(touches.sum())
        self.time_ms += len(force_g)


class FingerSkin:
    """The sensor on a finger, for one session.

    ``rest``: conductance without load, relative to the world's. Raises WrongUse for a parameter
    outside its plausible range.
    """

    def __init__(self, parameters: WorldParameters, seed: int, rest: float = 1.0) -> None:
        # A plate is flat, so no row of taxels stands off as on the drum's curve.
        self._p = replace(
            validated(parameters),
            circumference_mm=TABLE_MM,
            plate_length_mm=PLATE_MM,
            edge_drop_mm=0.0,
            rest_conductance=parameters.rest_conductance * rest,
        )
        self._motion = _Motion()
        self._skin = Skin(self._p, seed, cast("Mechanics", self._motion))
        self._plates: dict[str, ContactTables] = {}
        self._forces: ForceTable | None = None

    def begin_slide(self, number: int, plate: str, mounting: Mounting) -> None:
        """Lay out a plate for slide ``number``. Raises WrongUse for an unknown plate."""
        if plate not in self._plates:
            self._plates[plate] = contact_tables(plate, self._p)
        tables = self._plates[plate]
        self._skin.set_plate(tables, mounting)
        self._forces = force_table(tables, self._p, mounting)
        self._jump((number + 1) * MS_PER_SLIDE)
        self._motion.contacts = (number + 1) * CONTACTS_PER_SLIDE

    def advance(
        self, along_mm: NDArray[np.float64], force_g: NDArray[np.float64]
    ) -> NDArray[np.uint16]:
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

    def _advance(
        self, along_mm: NDArray[np.float64], force_g: NDArray[np.float64]
    ) -> NDArray[np.uint16]:
        first = self._motion.time_ms
        table_mm = along_mm + self._p.plate_start_mm
        depth_mm = np.zeros(len(force_g))
        if self._forces is not None and force_g.any():
            depth_mm = _depth_mm(self._forces, table_mm, force_g)
        self._motion.append(table_mm, force_g, depth_mm)
        self._skin.advance()
        # A frame's slots lie between two rows of levels, so the newest frame ends a row earlier.
        starts_us = np.arange(first - 1, first - 1 + len(force_g), dtype=np.float64) * 1000.0
        return self._skin.read(first, starts_us, SLOT_US)

    def _jump(self, time_ms: int) -> None:
        """Continue at another time, where noise has other numbers, from the present state."""
        now = self._motion.time_ms
        for rows in (self._motion.log, self._skin.levels):
            rows[[(time_ms - 1) % RING_MS, time_ms % RING_MS]] = rows[
                [(now - 1) % RING_MS, now % RING_MS]
            ]
        self._motion.time_ms = self._skin.time_ms = time_ms


def _depth_mm(
    forces: ForceTable, table_mm: NDArray[np.float64], force_g: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the depth at which the skin carries a force at each place, float64 (n,)."""
    positions = forces.force_g.shape[1]
    columns = forces.force_g[:, np.rint(table_mm / GRID_MM).astype(int) % positions]
    above = np.argmax(columns >= force_g, axis=0)
    row = np.clip(above, 1, len(columns) - 1)
    n = np.arange(len(force_g))
    low, high = columns[row - 1, n], columns[row, n]
    share = np.clip((force_g - low) / np.maximum(high - low, 1e-9), 0.0, 1.0)
    depth_mm: NDArray[np.float64] = (row - 1 + share) * forces.cell_mm - force_g * forces.frame_mm_g
    return np.where(force_g > 0.0, np.maximum(depth_mm, 0.0), 0.0)
