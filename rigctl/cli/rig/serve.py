"""Offer the simulated boards to other programs.

Offer the simulated boards over loopback TCP and as pseudo-terminals, in real time, until
Ctrl-C.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
from contextlib import closing
from dataclasses import asdict
from typing import Any

from rigctl.acquisition.rig import Rig
from rigctl.cli.data.world import add_world, chosen_world
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--rig", choices=(VIRTUAL, FIRMWARE), default=VIRTUAL)
    add_world(parser)
    parser.add_argument("--plate", default="A", metavar="A–P", help="texture on the drum")
    parser.add_argument("--seed", type=int, default=0, help="seed of the simulated world")
    parser.add_argument("--json", action="store_true", help="print the addresses as one JSON line")


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    world = chosen_world(args.world)
    print(
        "preparing the simulated bench; after an update this takes half a minute", file=sys.stderr
    )
    with closing(open_rig(args.rig, seed=args.seed, paced=True, world=world)) as rig:
        rig.set_plate(args.plate)
        rig.loop.run_until_complete(_serve(rig, args.json))
    return 0


async def _serve(rig: Rig, as_json: bool) -> None:
    from rigctl.simulation.board_server import Addresses, serve

    assert rig.simulation is not None
    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    started: asyncio.Future[dict[str, Addresses]] = loop.create_future()
    started.add_done_callback(lambda done: _say(done.result(), as_json))
    await serve(rig.simulation, stop, started)


def _say(boards: dict[str, Any], as_json: bool) -> None:
    if as_json:
        lines = [json.dumps({name: asdict(addresses) for name, addresses in boards.items()})]
    else:
        lines = [f"{name}: tcp {at.tcp}  port {at.pty}" for name, at in boards.items()]
        lines.append("press Ctrl-C to end")
    print("\n".join(lines), flush=True)
