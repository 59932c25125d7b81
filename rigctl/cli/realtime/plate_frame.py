"""Find the place of the plate in the tracker's frame: touch its four corners, one after another."""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path
from statistics import fmean

from rigctl.cli.options.terminal import ask
from rigctl.config.finger_config import load_finger_config
from rigctl.devices.trackers.open_tracker import open_tracker
from rigctl.devices.trackers.plate_frame import Vector, fit_plate_frame
from rigctl.devices.trackers.tracker import Tracker
from rigctl.errors import LinkLost, RigFault
from rigctl.protocol.finger import PLATE_CORNERS_MM
from rigctl.values import Position

NO_TERMINAL = "run it where you can press Enter at each corner"
TOUCH_S = 1.0
"""Time over which the positions at a corner are averaged."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    parser.add_argument(
        "--rig", type=Path, required=True, help="finger.toml that names the tracker"
    )
    parser.add_argument("--out", type=Path, default=Path("plate-frame.toml"), metavar="FILE")


def run(args: argparse.Namespace) -> int:
    """Ask for each corner, fit the frame and write it."""
    config = load_finger_config(args.rig)
    loop = asyncio.SelectorEventLoop()
    tracker = open_tracker(config.tracker.source, loop)
    try:
        touched = loop.run_until_complete(_touch_corners(tracker))
    finally:
        tracker.close()
        loop.close()
    frame = fit_plate_frame(touched)
    args.out.write_text(frame.to_toml(), encoding="utf-8")
    print(
        f"{args.out}: the corners are within {frame.residual_mm:.2f} mm of their places; set "
        f'frame = "{args.out.name}" under [tracker] in {args.rig}'
    )
    return 0


async def _touch_corners(tracker: Tracker) -> list[tuple[str, Vector]]:
    positions: list[Position] = []
    lost: list[str] = []
    tracker.open(positions.append, lost.append)
    touched = []
    for name in PLATE_CORNERS_MM:
        await asyncio.to_thread(
            ask, f"Touch the corner {name} of the plate and hold still.", NO_TERMINAL
        )
        positions.clear()
        await asyncio.sleep(TOUCH_S)
        if lost:
            raise LinkLost(lost[0])
        touched.append((name, _mean(name, positions)))
    return touched


def _mean(corner: str, positions: list[Position]) -> Vector:
    """Return the mean position. Raises RigFault where the tracker was lost."""
    valid = [position for position in positions if position.valid]
    if not valid:
        raise RigFault(f"the tracker had no position at the corner {corner}: bring it into view")
    x, y, z = (fmean(getattr(p, axis) for p in valid) for axis in ("x_mm", "y_mm", "z_mm"))
    return x, y, z
