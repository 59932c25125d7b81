"""``rigctl follow-engine``: the process that follows a session. The window starts it."""

from __future__ import annotations

import argparse
import asyncio
from contextlib import closing
from pathlib import Path

from rigctl.acquisition.follow.follow_engine import FollowCommands, FollowEngine
from rigctl.acquisition.follow.growing_session import GrowingSession
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.rpc.engine_files import FOLLOWED
from rigctl.cli.options.arguments import path_or_name, whole_number
from rigctl.cli.rig.engine_process import EngineProcess
from rigctl.errors import WrongUse
from rigctl.protocol.plan import MAX_SEED
from rigctl.values import N_TAXELS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command; those of every engine that have no use here, too."""
    parser.add_argument("--rig", type=path_or_name("--rig"), required=True)
    parser.add_argument("--name", default=None)
    parser.add_argument("--seed", type=whole_number("--seed", 0, MAX_SEED), default=0)
    parser.add_argument("--paced", action="store_true")


def run(args: argparse.Namespace) -> int:
    """Open the session, announce the follower, wait for its first client, serve."""
    growing = GrowingSession(Path(args.rig))
    if (n_taxels := growing.session.header.n_taxels) != N_TAXELS:
        raise WrongUse(
            f"{args.rig} has {n_taxels} taxels, but live views have {N_TAXELS}: open it in the "
            "panel Analysis"
        )
    process = EngineProcess(args.name, args.rig, FOLLOWED)
    loop = asyncio.SelectorEventLoop()
    with closing(loop), closing(LiveWriter(process.live_path)) as live:
        engine = FollowEngine(loop, growing, live)
        return process.serve(engine, FollowCommands(engine).handle, None)
