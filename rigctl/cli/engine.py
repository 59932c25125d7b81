"""``rigctl engine``: the process that holds a rig. Other commands and the window start it."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.cli.arguments import about_of, add_about
from rigctl.cli.engine_process import EngineProcess, add_engine_arguments, utc_now
from rigctl.cli.world import add_wirings, chosen_world, session_world
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.engine import Engine
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.run_request import RunRequest
from rigctl.rig import open_rig

if TYPE_CHECKING:
    from rigctl.bench.world_file import SimulatedWorld


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_engine_arguments(parser, protocol=None)
    add_wirings(parser)
    add_about(parser)


def run(args: argparse.Namespace) -> int:
    """Open the rig, announce the engine, wait for its first client, serve."""
    rig = open_rig(
        args.rig, seed=args.seed, paced=args.paced, world=_world(args), wirings=args.wire
    )
    with closing(rig):
        process = EngineProcess(args.name, args.rig, is_bench=not rig.simulated, world=args.world)
        live = LiveWriter(process.live_path, rig.config.taxels.count)
        engine = Engine(rig, live, utc_now, real_time=args.paced or not rig.simulated)
        with closing(live):
            return process.serve(engine, DrumCommands(engine).handle, _run_request(args))


def _run_request(args: argparse.Namespace) -> RunRequest | None:
    if args.protocol is None and args.resume is None:
        return None
    plan = args.protocol, args.out, args.resume, args.order_seed, args.yes
    return RunRequest(*plan, **about_of(args))


def _world(args: argparse.Namespace) -> SimulatedWorld | None:
    """Return the world of the named file, or that of the session to resume."""
    if args.world is None and args.resume is not None:
        return session_world(Path(args.resume))
    return chosen_world(args.world)
