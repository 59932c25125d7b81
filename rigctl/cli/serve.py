"""Offer the simulated boards to other programs.

Offer the simulated boards over loopback TCP and as pseudo-terminals, in real time, until
Ctrl-C: those of the drum, or with --finger the moving finger's board, its tracker, and a line to
the virtual person who slides it. Names of the ports are printed at the start.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rigctl.cli.arguments import add_option, add_seed, whole_number
from rigctl.cli.world import add_wirings, add_world, chosen_world
from rigctl.errors import WrongUse
from rigctl.experiments import EXPERIMENTS, FINGER_EXPERIMENT
from rigctl.rig import FIRMWARE, VIRTUAL, open_rig

if TYPE_CHECKING:
    from rigctl.bench.board_server import Addresses, ServedLink
    from rigctl.bench.world_file import SimulatedWorld

PREPARING = "preparing the simulated bench; after an update this takes half a minute"

OPEN_TO_ALL = (
    "any user of this computer can connect to the TCP ports; --pty-only offers pseudo-terminals "
    "alone, which are yours"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--rig", choices=(VIRTUAL, FIRMWARE), default=VIRTUAL)
    add_world(parser)
    add_wirings(parser)
    parser.add_argument("--plate", metavar="A–P", help="texture on the drum (A)")
    add_seed(parser, "seed of the simulated world", default=0)
    parser.add_argument("--json", action="store_true", help="print the addresses as one JSON line")
    parser.add_argument(
        "--pty-only",
        action="store_true",
        help="offer pseudo-terminals, which are this user's alone, and no TCP ports",
    )
    finger = parser.add_argument_group("the moving finger")
    finger.add_argument(
        "--finger", action="store_true", help="offer the moving finger instead of the drum"
    )
    add_option(
        finger,
        "--udp",
        whole_number(1, 65_535),
        "PORT",
        "send the tracker's positions to this port, too",
    )
    add_option(finger, "--session", whole_number(0), "N", "session of the person (0)")


def run(args: argparse.Namespace) -> int:
    """Serve until Ctrl-C or SIGTERM."""
    _require_fitting_options(args)
    world = chosen_world(args.world)
    if not args.pty_only:
        print(OPEN_TO_ALL, file=sys.stderr)
    print(PREPARING, file=sys.stderr)
    if args.finger:
        EXPERIMENTS[FINGER_EXPERIMENT].load("serve")(args, world)
    else:
        _serve_drum(args, world)
    return 0


def _require_fitting_options(args: argparse.Namespace) -> None:
    if args.finger and args.rig != VIRTUAL:
        raise WrongUse("the finger's image under QEMU is slower than real time: use --rig virtual")
    if args.finger and args.wire:
        raise WrongUse("the wirings are those of the drum's bench: leave --wire out")
    if args.finger and args.plate is not None:
        raise WrongUse("the person chooses the finger's plate: leave --plate out")
    if not args.finger and (args.udp is not None or args.session is not None):
        raise WrongUse("--udp and --session belong to the moving finger: add --finger")
    if args.pty_only and not hasattr(os, "openpty"):
        raise WrongUse("this system has no pseudo-terminals: leave --pty-only out")
    if args.pty_only and args.udp is not None:
        raise WrongUse("--pty-only offers no ports: leave --udp out")


def _serve_drum(args: argparse.Namespace, world: SimulatedWorld | None) -> None:
    opened = open_rig(args.rig, seed=args.seed, paced=True, world=world, wirings=args.wire)
    with closing(opened) as rig:
        rig.set_plate(args.plate or "A")
        assert rig.simulation is not None
        links = (rig.simulation.drum, rig.simulation.taxels)
        rig.loop.run_until_complete(serve_links(links, args))


async def serve_links(links: Sequence[ServedLink], args: argparse.Namespace) -> None:
    """Offer links until a signal comes; their addresses are printed first."""
    from rigctl.bench.board_server import serve

    loop = asyncio.get_running_loop()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    started: asyncio.Future[dict[str, Addresses]] = loop.create_future()
    started.add_done_callback(lambda done: _say(done.result(), args.json))
    await serve(links, stop, started, args.pty_only)


def _say(served: dict[str, Any], as_json: bool) -> None:
    if as_json:
        lines = [json.dumps({name: asdict(addresses) for name, addresses in served.items()})]
    else:
        lines = [
            f"{name}: {f'tcp {at.tcp}  ' if at.tcp else ''}port {at.pty}"
            for name, at in served.items()
        ]
        lines.append("press Ctrl-C to end")
    print("\n".join(lines), flush=True)
