"""Find the place of the plate in the tracker's frame: touch its four corners, one after another."""

from __future__ import annotations

import argparse
import asyncio
import os
from pathlib import Path
from statistics import fmean

from rigctl.cli.arguments import a_path, add_option
from rigctl.cli.progress import ask
from rigctl.errors import LinkLost, RigFault, WrongUse
from rigctl.finger.config import load_finger_config
from rigctl.finger.open_rig import configured_tracker
from rigctl.finger.trackers.plate_frame import PlateFrame, Vector, fit_plate_frame
from rigctl.finger.trackers.tracker import Tracker
from rigctl.finger.values import PLATE_CORNERS_MM
from rigctl.values import Position

NO_TERMINAL = "run it where you can press Enter at each corner"
FRAME_FILE = "plate-frame.toml"
TOUCH_S = 1.0
"""Time over which the positions at a corner are averaged."""
CHECK_PERIOD_S = 0.01


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the part."""
    add_option(
        parser, "--rig", a_path, help_text="finger.toml that names the tracker", required=True
    )
    add_option(parser, "--out", a_path, "FILE", f"file to write ({FRAME_FILE} beside finger.toml)")


def run(args: argparse.Namespace) -> int:
    """Ask for each corner, fit the frame and write it."""
    file = args.out or args.rig.parent / FRAME_FILE
    frame = fit_plate_frame(_touched_corners(args.rig))
    _write(file, frame)
    # finger.toml names the file relative to its own folder.
    name = Path(os.path.relpath(file, args.rig.parent)).as_posix()
    print(
        f"{file}: the corners are within {frame.residual_mm:.2f} mm of their places; set "
        f'frame = "{name}" under [tracker] in {args.rig}'
    )
    return 0


def _touched_corners(rig: Path) -> list[tuple[str, Vector]]:
    config = load_finger_config(rig)
    loop = asyncio.SelectorEventLoop()
    try:
        tracker = configured_tracker(rig, config, loop)
        try:
            return loop.run_until_complete(_touch_corners(tracker))
        finally:
            tracker.close()
    finally:
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()


async def _touch_corners(tracker: Tracker) -> list[tuple[str, Vector]]:
    positions: list[Position] = []
    lost: list[str] = []
    tracker.open(positions.append, lost.append)
    touched = []
    for name in PLATE_CORNERS_MM:
        await asyncio.to_thread(
            ask, f"Touch the corner {name} of the plate and hold still.", NO_TERMINAL
        )
        begin_s = asyncio.get_running_loop().time()
        end_s = begin_s + TOUCH_S
        # Positions come late: what was measured before the touch may still be on its way.
        while not lost and not (positions and positions[-1].at_s > end_s):
            await asyncio.sleep(CHECK_PERIOD_S)
        if lost:
            raise LinkLost(lost[0])
        touched.append((name, _mean(name, [p for p in positions if begin_s <= p.at_s <= end_s])))
        positions.clear()
    return touched


def _mean(corner: str, positions: list[Position]) -> Vector:
    """Return the mean position. Raises RigFault where the tracker was lost."""
    valid = [position for position in positions if position.valid]
    if not valid:
        raise RigFault(f"the tracker had no position at the corner {corner}: bring it into view")
    x, y, z = (fmean(getattr(p, axis) for p in valid) for axis in ("x_mm", "y_mm", "z_mm"))
    return x, y, z


def _write(file: Path, frame: PlateFrame) -> None:
    try:
        file.write_text(frame.to_toml(), encoding="utf-8")
    except OSError as error:
        raise WrongUse(f"cannot write {file}: {error.strerror}") from error
