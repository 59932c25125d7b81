"""Draws ``mechanics.svg``: drum, carriage, load cell and sensor bed with their dimensions.

    python arduino/mechanics.py            write the drawing
    python arduino/mechanics.py --check    exit code 1 where the drawing is stale

Turn and travel come from ``drum/board.h``, plates and sensor from the parameters and the solids of
the simulated bench. Needs the installed package.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from math import cos, pi, sin
from pathlib import Path

from rigctl.bench.parameters import WorldParameters
from rigctl.bench.plate_solids import (
    BARB_MM,
    CLAMP_MM,
    FOOT_MM,
    FOOT_THICKNESS_MM,
    SNAP_FROM_EDGE_MM,
    SNAP_RADIUS_MM,
    THICKNESS_MM,
)
from rigctl.bench.textures import OVERHANG_MM
from rigctl.values import PLATE_WIDTH_MM

HERE = Path(__file__).parent
DRAWING = HERE / "mechanics.svg"
WIDTH, HEIGHT, PX_PER_MM = 1180, 900, 2.6
STEEL, PART, INK, ACCENT = "#dfe5ea", "#f6f1e4", "#222222", "#1565c0"
STOP_MM = 2.0
"""How far below the contact a mechanical stop holds the carriage: 1,800 g at 900 g/mm."""


def turn_and_travel_mm() -> tuple[float, float]:
    """Return the texture travel of a turn and the actuator's travel, as in ``drum/board.h``."""
    text = (HERE / "drum" / "board.h").read_text(encoding="utf-8")
    turn, travel = (
        re.search(pattern, text)
        for pattern in (r"NM_PER_TURN = (\d+)UL", r"ACTUATOR_TRAVEL_UM = (\d+)")
    )
    assert turn is not None
    assert travel is not None
    return int(turn[1]) / 1e6, int(travel[1]) / 1e3


def drawing() -> str:
    """Return the sheet as SVG."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}" font-family="DejaVu Sans, Verdana, sans-serif">'
    )
    body = [
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="#ffffff"/>',
        _text(40, 40, "Mechanics of the drum rig", 22, weight="bold"),
        _text(
            40,
            64,
            "Dimensions in mm. The paper gives none of the drum: these are the project's.",
            13,
        ),
        *_side_view(330.0, 500.0),
        *_front_view(820.0, 500.0),
        *_slot(830.0, 180.0),
    ]
    return "\n".join([head, *body, "</svg>", ""])


def _side_view(x: float, y: float) -> Iterator[str]:
    """The view along the drum's axis, which is at x, y."""
    turn_mm, travel_mm = turn_and_travel_mm()
    foot_mm = turn_mm / (2 * pi)
    radius = foot_mm * PX_PER_MM
    yield _text(x - 280, 110, "Along the axis", 15, weight="bold")
    yield _box(x - 285, 130, 26, 700, STEEL)  # frame
    yield _box(x - 285, 804, 560, 26, STEEL)
    yield _box(x - 260, 140, 330, 22, STEEL)
    yield _box(x - 22, 162, 44, 84, PART)
    yield _text(x + 32, 196, f"linear actuator, {travel_mm:g} mm of travel,", 12)
    yield _text(x + 32, 212, "pushes the carriage down; 0 is the upper end", 12)
    yield _box(x - 9, 246, 18, 30, STEEL)
    yield _box(x - 130, 276, 260, 18, STEEL)
    yield _text(x + 140, 290, "carriage, on the frame's rails", 12)
    yield _box(x - 90, 294, 180, 16, PART)
    yield _text(x + 100, 309, "load cell, a bar: one end on the carriage,", 12)
    yield _text(x + 100, 325, "the other carries fork, motor and drum", 12)
    yield _box(x - 7, 310, 14, y - 310, STEEL)
    yield _circle(x, y, radius, "#ffffff")
    yield _circle(x, y, radius - THICKNESS_MM * PX_PER_MM, PART)
    yield from _gap(x, y, radius)
    yield _circle(x, y, 9, STEEL)
    yield from _dimension(x, y + 22, x + radius, y + 22, f"r {foot_mm:.2f}")
    yield _text(x - 120, y + 60, f"r is that of the texture's foot: a turn is {turn_mm:g}", 12)
    bed = y + radius
    yield _box(x - 60, bed + 3, 120, 12, "#cfe8cf")
    yield _box(x - 90, bed + 15, 180, 804 - bed - 15, PART)
    yield _text(x + 100, bed + 12, "sensor, 3 × 3 × 2 taxels", 12)
    yield _text(x + 100, bed + 50, "sensor bed, on the frame,", 12)
    yield _text(x + 100, bed + 66, "below the axis", 12)
    yield _box(x - 262, 330, 40, 12, "#f3c6c6")
    yield _text(x - 256, 362, "mechanical stop:", 12)
    yield _text(x - 256, 378, f"carriage {STOP_MM:g} below", 12)
    yield _text(x - 256, 394, "first contact", 12)
    yield _text(x - 256, bed + 40, f"contact at {WorldParameters().contact_mm:g} of travel", 12)
    yield _text(x - 256, bed + 56, "or where yours is", 12)


def _gap(x: float, y: float, radius: float) -> Iterator[str]:
    """The slot in the drum, the index mark, and where the texture begins."""
    turn_mm, _ = turn_and_travel_mm()
    texture_mm = WorldParameters().plate_start_mm
    marks = ((0.0, "index mark", -14, "end"), (texture_mm, "texture begins", 8, "start"))
    for at_mm, name, beside, anchor in marks:
        angle = 2 * pi * at_mm / turn_mm
        sx, sy = sin(angle), -cos(angle)
        inner, outer = radius - 14, radius + 10
        yield _line(x + sx * inner, y + sy * inner, x + sx * outer, y + sy * outer)
        yield _text(x + sx * outer + beside, y + sy * outer + 6, name, 11, anchor)


def _front_view(x: float, y: float) -> Iterator[str]:
    """The view across the axis: widths."""
    turn_mm, _ = turn_and_travel_mm()
    radius, half = turn_mm / (2 * pi) * PX_PER_MM, PLATE_WIDTH_MM / 2 * PX_PER_MM
    yield _text(x - 60, 318, "Across the axis", 15, weight="bold")
    yield _box(x - half, y - radius, 2 * half, 2 * radius, PART)
    yield _box(x - half - 40, y - 5, 2 * half + 200, 10, STEEL)
    snap = x - half + SNAP_FROM_EDGE_MM * PX_PER_MM
    yield _line(snap, y - radius, snap, y + radius, "#888888")
    yield _text(x - half - 118, y - radius + 30, f"groove, r {SNAP_RADIUS_MM:g},", 12)
    yield _text(x - half - 118, y - radius + 46, f"{SNAP_FROM_EDGE_MM:g} from the edge", 12)
    yield from _dimension(
        x - half, y + radius + 34, x + half, y + radius + 34, f"{PLATE_WIDTH_MM:g}"
    )
    taxels = 3 * WorldParameters().taxel_pitch_mm * PX_PER_MM
    yield _box(x - taxels / 2, y + radius + 3, taxels, 10, "#cfe8cf")
    yield _text(x + half + 10, y + radius + 13, f"taxels {taxels / PX_PER_MM:g} wide, centred", 12)
    yield _box(x + half + 40, y - 60, 24, 120, STEEL)
    yield _box(x + half + 40, y - 150, 24, 60, STEEL)
    yield _text(x + half + 76, y - 110, "stepper, 200 steps", 12)
    yield _text(x + half + 76, y - 94, "belt 4 : 1", 12)


def _slot(x: float, y: float) -> Iterator[str]:
    """The slot of the drum with both feet in it, five times as large."""
    scale = 7.0
    gap_mm = turn_and_travel_mm()[0] - (WorldParameters().plate_length_mm + 2 * OVERHANG_MM)
    width_mm = gap_mm + 2 * FOOT_THICKNESS_MM
    left, right = x - width_mm / 2 * scale, x + width_mm / 2 * scale
    depth = (FOOT_MM + 1) * scale
    yield _text(x - 70, 110, "Slot of the drum, with the plate's feet", 15, weight="bold")
    yield _box(left - 120, y, 120, depth, STEEL)
    yield _box(right, y, 120, depth, STEEL)
    yield _box(left - 120, y + depth, right - left + 240, 14, STEEL)
    for start, sign in ((left, 1), (right, -1)):
        foot, barb = FOOT_THICKNESS_MM * scale * sign, BARB_MM * scale * sign
        points = [
            (start - 120 * sign, y - THICKNESS_MM * scale),
            (start + foot, y - THICKNESS_MM * scale),
            (start + foot, y + FOOT_MM * scale),
            (start, y + FOOT_MM * scale),
            (start - barb, y + (FOOT_MM - 1) * scale),
            (start, y + (FOOT_MM - 2) * scale),
            (start, y),
            (start - 120 * sign, y),
        ]
        path = " ".join(f"{px:.1f},{py:.1f}" for px, py in points)
        yield f'<polygon points="{path}" fill="{PART}" stroke="{INK}" stroke-width="1.4"/>'
    yield from _dimension(left, y + depth + 34, right, y + depth + 34, f"{width_mm:g}")
    yield _text(right + 130, y - 4, f"plate {THICKNESS_MM:g} thick", 12)
    yield _text(right + 130, y + 20, f"slot {FOOT_MM + 1:g} deep,", 12)
    yield _text(right + 130, y + 36, f"undercut {BARB_MM:g}", 12)
    yield _text(
        left - 120,
        y + depth + 66,
        f"of a turn, {CLAMP_MM:g} are free of texture; the plate is pushed on along the axis",
        12,
    )


def _dimension(x1: float, y1: float, x2: float, y2: float, text: str) -> Iterator[str]:
    yield _line(x1, y1, x2, y2, ACCENT)
    for x, y in ((x1, y1), (x2, y2)):
        yield _line(x, y - 5, x, y + 5, ACCENT)
    yield _text((x1 + x2) / 2, y1 - 5, text, 12, "middle", colour=ACCENT)


def _box(x: float, y: float, width: float, height: float, fill: str) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{fill}" '
        f'stroke="{INK}" stroke-width="1.4"/>'
    )


def _circle(x: float, y: float, radius: float, fill: str) -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{fill}" stroke="{INK}" '
        'stroke-width="1.4"/>'
    )


def _line(x1: float, y1: float, x2: float, y2: float, colour: str = INK) -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}" '
        'stroke-width="1.4"/>'
    )


def _text(
    x: float,
    y: float,
    text: str,
    size: int,
    anchor: str = "start",
    weight: str = "normal",
    colour: str = INK,
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" '
        f'font-weight="{weight}" fill="{colour}">{text}</text>'
    )


def main(arguments: list[str]) -> int:
    """Write the drawing, or compare it."""
    if arguments != ["--check"]:
        DRAWING.write_text(drawing(), encoding="utf-8")
        return 0
    same = DRAWING.is_file() and DRAWING.read_text(encoding="utf-8") == drawing()
    if not same:
        print("mechanics.svg is stale: run make docs")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
