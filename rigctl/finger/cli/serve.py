"""Offer the virtual finger's board, tracker and person to other programs."""

from __future__ import annotations

import argparse
from contextlib import closing
from typing import TYPE_CHECKING

from rigctl.cli.serve import serve_links
from rigctl.finger.bench.served import PersonCable, TrackerCable
from rigctl.finger.open_rig import VIRTUAL, open_finger_rig

if TYPE_CHECKING:
    from rigctl.bench.world_file import SimulatedWorld


def serve_finger(args: argparse.Namespace, world: SimulatedWorld | None) -> None:
    """Serve until a signal comes, for ``rigctl serve --finger``."""
    opened = open_finger_rig(VIRTUAL, seed=args.seed, session=args.session or 0, world=world)
    with closing(opened) as rig:
        finger = rig.simulation
        tracker, person = TrackerCable(finger.tracker, args.udp), PersonCable(finger, rig.loop)
        rig.loop.run_until_complete(serve_links((finger.finger, tracker, person), args))
