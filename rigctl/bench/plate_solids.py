"""The texture plates as solids to print: those bent over the drum, and flat ones.

Their heights are those of the catalogue that the simulated bench presses
(:mod:`rigctl.bench.textures`). The paper gives the flat plates' size; thickness, feet,
snap and label are dimensions of this project (docs/how-to/build-the-rig.md draws them).

A plate's section lies in the plane of travel (x, mm) and height (y, mm): y = 0 is the foot of the
texture. A foot at either end reaches down into the slot of the drum, or over the edge of a board.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigctl.bench.parameters import WorldParameters, validated
from rigctl.bench.textures import (
    OVERHANG_MM,
    Texture,
    find_texture,
    plate_names,
    printed_heights,
)
from rigctl.values import PLATE_WIDTH_MM

THICKNESS_MM = 3.0
FOOT_MM, FOOT_THICKNESS_MM, BARB_MM = 5.0, 2.0, 0.8
"""How far a foot reaches down, how thick it is, and how far its barb reaches under the drum."""
SNAP_RADIUS_MM, SNAP_FROM_EDGE_MM = 0.6, 4.0
"""The ridge inside the bent plate that snaps into a groove around the drum."""
LABEL_HEIGHT_MM, LABEL_DEPTH_MM = 7.0, 0.6
CLAMP_MM = 30.0
"""Of a turn, what the texture leaves free: its overhangs and the slot for the feet."""
LONGEST_MM = 385.0
TOLERANCE_MM = 0.002
"""Facets that differ by less become one: what a file of 32-bit numbers could not tell apart."""
STEP_MM = 0.1
"""Distance of points along ridges; a facet of a drum of 64 mm is then flat to 0.02 µm."""
FLANK_MM = 0.001
"""Travel in which a rectangular ridge rises: a wall, for any printer."""

_Points = NDArray[np.float64]


def fitted_to_drum(parameters: WorldParameters, drum_radius_mm: float) -> WorldParameters:
    """Return the parameters with a turn and a plate for a drum of this radius below its plates.

    Raises WrongUse where a turn would be outside the plausible range of the bench.
    """
    turn_mm = 2.0 * pi * (drum_radius_mm + THICKNESS_MM)
    length_mm = min(turn_mm - CLAMP_MM, LONGEST_MM)
    return validated(replace(parameters, circumference_mm=turn_mm, plate_length_mm=length_mm))


def base_radius_mm(parameters: WorldParameters) -> float:
    """Return the radius of the texture's foot: a turn there is the bench's circumference."""
    return parameters.circumference_mm / (2.0 * pi)


def drum_plate(texture: Texture, parameters: WorldParameters) -> Any:
    """Return a plate bent over the drum as a ``manifold3d.Manifold``, mm; the axis is z.

    The ring is open where the feet reach into the drum's slot. It is pushed on along the axis.
    """
    from manifold3d import CrossSection, Manifold

    radius_mm = base_radius_mm(parameters)
    section = _section(texture, parameters, -OVERHANG_MM, parameters.plate_length_mm + OVERHANG_MM)
    body = Manifold.extrude(CrossSection([_bend(section, radius_mm)]), PLATE_WIDTH_MM)
    label = _label(texture, parameters, parameters.plate_length_mm / 2.0).refine_to_length(1.0)
    label = label.warp_batch(lambda points: _bend_solid(points, radius_mm))
    return (body + _snap(section, radius_mm) - label).set_tolerance(TOLERANCE_MM)


def flat_plate(texture: Texture, parameters: WorldParameters, length_mm: float) -> Any:
    """Return a flat plate as a ``manifold3d.Manifold``, mm: x travel, y height, z across."""
    from manifold3d import CrossSection, Manifold

    section = _section(texture, parameters, 0.0, length_mm)
    body = Manifold.extrude(CrossSection([section]), PLATE_WIDTH_MM)
    return body - _label(texture, parameters, length_mm / 2.0)


def write_drum_plates(folder: Path, parameters: WorldParameters) -> Iterator[Path]:
    """Write the drum's plates to a folder; yield each path."""
    for name in plate_names(parameters):
        path = folder / f"drum-{name}.stl"
        write_stl(path, drum_plate(find_texture(name, parameters), parameters), f"plate {name}")
        yield path


def write_stl(path: Path, solid: Any, title: str) -> None:
    """Write a solid as a binary STL file in mm; ``title`` stands in its header of 80 bytes."""
    mesh = solid.to_mesh()
    corners = np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    facets = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    facets["normal"], facets["corners"] = normals, corners
    head = title.encode("ascii", "replace")[:80].ljust(80)
    path.write_bytes(head + struct.pack("<I", len(facets)) + facets.tobytes())


def _section(
    texture: Texture, parameters: WorldParameters, first_mm: float, last_mm: float
) -> _Points:
    """Return the section (n, 2) of a plate in mm, counter-clockwise, with a foot at each end."""
    inner_mm, foot_mm = -THICKNESS_MM, -THICKNESS_MM - FOOT_MM
    end, barb = FOOT_THICKNESS_MM, FOOT_THICKNESS_MM + BARB_MM
    corners = [
        (0, foot_mm),
        (end, foot_mm),
        (barb, foot_mm + 1),
        (end, foot_mm + 2),
        (end, inner_mm),
    ]
    foot = np.array(corners, dtype=np.float64)
    inside = np.arange(first_mm + FOOT_THICKNESS_MM, last_mm - FOOT_THICKNESS_MM, 5 * STEP_MM)[1:]
    below = np.column_stack([inside, np.full_like(inside, inner_mm)])
    along_mm = _travel(texture, parameters, first_mm, last_mm)
    heights_mm = printed_heights(texture, along_mm, parameters)
    top = np.column_stack([along_mm, heights_mm])[::-1]
    right = (np.array([last_mm, 0.0]) + foot * np.array([-1.0, 1.0]))[::-1]
    return np.concatenate([foot + np.array([first_mm, 0.0]), below, right, top])


def _travel(
    texture: Texture, parameters: WorldParameters, first_mm: float, last_mm: float
) -> _Points:
    """Return the travel (n,), mm, at which the section has a point: both ends of a flank too."""
    along_mm = np.arange(first_mm, last_mm, STEP_MM)
    space_mm = parameters.base_space_mm * texture.space
    share = texture.ridge_share or parameters.ridge_share
    starts = np.arange(np.floor(first_mm / space_mm), np.ceil(last_mm / space_mm) + 1) * space_mm
    edges = np.concatenate([starts, starts + share * space_mm])
    flanks = np.concatenate([edges - FLANK_MM / 2.0, edges + FLANK_MM / 2.0])
    points = np.unique(np.concatenate([along_mm, flanks, [last_mm]]))
    points = points[(points >= first_mm) & (points <= last_mm)]
    apart: NDArray[np.bool_] = np.diff(points, prepend=-np.inf) > FLANK_MM / 4.0
    return points[apart]


def _bend(section: _Points, radius_mm: float) -> _Points:
    """Return points (…, 2) of travel and height on a drum whose texture has this radius, mm."""
    angle, out_mm = section[..., 0] / radius_mm, radius_mm + section[..., 1]
    return np.stack([out_mm * np.sin(angle), out_mm * np.cos(angle)], axis=-1)


def _bend_solid(points: _Points, radius_mm: float) -> _Points:
    return np.column_stack([_bend(points[:, :2], radius_mm), points[:, 2]])


def _snap(section: _Points, radius_mm: float) -> Any:
    """Return the half-round ridge around the inside of the bent plate."""
    from manifold3d import CrossSection, Manifold

    turn_deg = 360.0 / (2.0 * pi * radius_mm)
    first_mm, last_mm = section[:, 0].min(), section[:, 0].max()
    inner_mm = radius_mm - THICKNESS_MM
    circle = CrossSection.circle(SNAP_RADIUS_MM, 24).translate((inner_mm, SNAP_FROM_EDGE_MM))
    # 499 corners: as a prime, never at the same angle as a corner of the section.
    ridge = Manifold.revolve(circle, 499, (last_mm - first_mm) * turn_deg)
    # A turned body begins at x and goes against the clock; travel begins at y and goes with it.
    return ridge.rotate((0.0, 0.0, 90.0 - last_mm * turn_deg))


def _label(texture: Texture, parameters: WorldParameters, middle_mm: float) -> Any:
    """Return the letters to cut into the back, readable from there, centred at a travel."""
    from manifold3d import CrossSection, FillRule, Manifold
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    size_mm = (
        f" {parameters.base_height_mm * texture.height:g}/"
        f"{parameters.base_space_mm * texture.space:g} mm"
        if texture.height
        else ""
    )
    text = f"{texture.name}  {texture.group}{size_mm}"
    path = TextPath((0, 0), text, LABEL_HEIGHT_MM, prop=FontProperties(family="DejaVu Sans"))
    outlines = [np.asarray(outline)[:-1] for outline in path.to_polygons()]
    letters = CrossSection(outlines, FillRule.EvenOdd)
    left, low, right, high = letters.bounds()
    letters = letters.translate((middle_mm - (left + right) / 2, -(low + high) / 2))
    solid = Manifold.extrude(letters, THICKNESS_MM).rotate((90.0, 0.0, 0.0))
    return solid.translate((0.0, LABEL_DEPTH_MM - THICKNESS_MM, PLATE_WIDTH_MM / 2.0))
