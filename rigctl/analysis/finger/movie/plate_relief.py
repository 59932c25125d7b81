"""The relief of a simulated plate as the world of its session describes it."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigctl.errors import SessionError
from rigctl.protocol.finger import PLATE_MM
from rigctl.session.header import SessionHeader
from rigctl.simulation.bench.textures import CATALOGUE, find_texture, printed_heights
from rigctl.simulation.bench.world.world_file import world_from_header

CELL_MM = 0.25


class PlateRelief(NamedTuple):
    """Printed heights along a plate, float64 (cells,) in mm, a cell of 0.25 mm after the other.

    ``words``: the texture in a few words, such as "waves, 16 mm apart".
    """

    heights_mm: NDArray[np.float64]
    words: str


def plate_relief(header: SessionHeader, texture: str, path: Path) -> PlateRelief | None:
    """Return the relief of a plate, or None where it is not known.

    It is not on a real rig, and not in the world of another version of rigctl.
    """
    if not header.simulated or texture not in CATALOGUE:
        return None
    try:
        world = world_from_header(header.simulation, path)
    except SessionError:
        return None
    if world is None:
        return None
    plate = find_texture(texture, world.parameters)
    along_mm = np.arange(0.0, PLATE_MM, CELL_MM) + CELL_MM / 2
    heights = printed_heights(plate, along_mm, world.parameters)
    if plate.height == 0.0:
        return PlateRelief(np.zeros_like(along_mm), plate.group)
    space_mm = world.parameters.base_space_mm * plate.space
    return PlateRelief(heights, f"{plate.group}, {space_mm:g} mm apart")
