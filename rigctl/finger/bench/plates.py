"""Write the finger's flat plates as STL files to print."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.plate_solids import flat_plate, write_stl
from rigctl.bench.textures import find_texture
from rigctl.finger.values import PLATE_MM, TEXTURES


def write_flat_plates(folder: Path, parameters: WorldParameters) -> Iterator[Path]:
    """Write the flat plates to a folder; yield each path."""
    for name in TEXTURES:
        path, texture = folder / f"flat-{name}.stl", find_texture(name, parameters)
        write_stl(path, flat_plate(texture, parameters, PLATE_MM), f"flat {name}")
        yield path
