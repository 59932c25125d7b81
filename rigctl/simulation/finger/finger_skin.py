"""The bench's skin on a finger: readings of the 3 × 3 taxels of the top layer during a slide."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from rigctl.protocol.finger import PLATE_MM
from rigctl.simulation.bench.contact import (
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
from rigctl.simulation.bench.parameters import WorldParameters
from rigctl.simulation.bench.skin import SLOT_US, Skin
from rigctl.simulation.bench.textures import GRID_MM
from rigctl.simulation.finger.operator import Slide
from rigctl.values import DRAWN_WIRING
from rigctl.wire.finger.messages import N_TAXELS

TABLE_MM = 400.0
"""Length of the tables of plate and clamp; a flat plate ends where a drum's clamp would begin."""
_CHUNK_MS = RING_MS // 2
_TOP_LAYER = np.array(DRAWN_WIRING[:N_TAXELS])


class _Motion:
    """The finger in the place of the bench's mechanics: what the skin reads of them."""

    def __init__(self) -> None:
        self.time_ms = 0
        self.contacts = 0
        self.log = np.zeros((RING_MS, 5))

    def append(self, along_mm: NDArray[np.float64], rows: NDArray[np.float64]) -> None:
        """Add milliseconds: position, and force and depth (n, 2)."""
        force_g = rows[:, 0]
        before = self.log[self.time_ms % RING_MS, FORCE_G]
        touches = (force_g > 0) & (np.concatenate([[before], force_g[:-1]]) <= 0)
        at = np.arange(self.time_ms + 1, self.time_ms + 1 + len(rows)) % RING_MS
        self.log[at, DRUM_MM] = along_mm
        self.log[at, FORCE_G], self.log[at, DEPTH_MM] = force_g, rows[:, 1]
        self.log[at, CONTACTS] = self.contacts + np.cumsum(touches)
        self.contacts += int(touches.sum())
        self.time_ms += len(rows)


class FingerSkin:
    """The sensor on a finger, for one session. Its time only moves with slides."""

    def __init__(self, parameters: WorldParameters, seed: int) -> None:
        # A plate is flat, so no row of taxels stands off as on the drum's curve.
        self._p = replace(
            parameters, circumference_mm=TABLE_MM, plate_length_mm=PLATE_MM, edge_drop_mm=0.0
        )
        self._motion = _Motion()
        self._skin = Skin(self._p, seed, cast("Mechanics", self._motion))

    def slide(self, plate: str, mounting: Mounting, slide: Slide) -> NDArray[np.uint16]:
        """Return the readings of a slide over a plate, uint16 (n, 9)."""
        tables = contact_tables(plate, self._p)
        self._skin.set_plate(tables, mounting)
        along_mm = slide.along_mm + self._p.plate_start_mm
        forces = force_table(tables, self._p, mounting)
        rows = np.stack([slide.force_g, _depth_mm(forces, along_mm, slide.force_g)], axis=1)
        readings = [
            self._advance(along_mm[at : at + _CHUNK_MS], rows[at : at + _CHUNK_MS])
            for at in range(0, len(rows), _CHUNK_MS)
        ]
        return np.concatenate(readings)

    def _advance(
        self, along_mm: NDArray[np.float64], rows: NDArray[np.float64]
    ) -> NDArray[np.uint16]:
        first = self._motion.time_ms
        self._motion.append(along_mm, rows)
        self._skin.advance()
        # A frame's slots lie between two rows of levels, so the newest frame ends a row earlier.
        starts_us = np.arange(first - 1, first - 1 + len(rows), dtype=np.float64) * 1000.0
        counts = self._skin.read(first, starts_us, SLOT_US)
        top_layer: NDArray[np.uint16] = counts[:, _TOP_LAYER]
        return top_layer


def _depth_mm(
    forces: ForceTable, along_mm: NDArray[np.float64], force_g: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the depth at which the skin carries a force at each place, float64 (n,)."""
    positions = forces.force_g.shape[1]
    columns = forces.force_g[:, np.rint(along_mm / GRID_MM).astype(int) % positions]
    above = np.argmax(columns >= force_g, axis=0)
    row = np.clip(above, 1, len(columns) - 1)
    n = np.arange(len(force_g))
    low, high = columns[row - 1, n], columns[row, n]
    share = np.clip((force_g - low) / np.maximum(high - low, 1e-9), 0.0, 1.0)
    depth_mm: NDArray[np.float64] = (row - 1 + share) * forces.cell_mm - force_g * forces.frame_mm_g
    return np.where(force_g > 0.0, np.maximum(depth_mm, 0.0), 0.0)
