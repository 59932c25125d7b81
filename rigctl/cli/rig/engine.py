"""``rigctl engine``: the process that holds a rig. Other commands and the window start it."""

from __future__ import annotations

import argparse
import asyncio
import os
import secrets
import signal
import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rigctl.acquisition.engine import Engine
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.acquisition.rpc.command_handler import CommandHandler
from rigctl.acquisition.rpc.engine_files import (
    EngineFile,
    new_engine_name,
    runtime_folder,
    write_engine_file,
)
from rigctl.acquisition.rpc.server import EngineAddress, accept_first_client, open_listener
from rigctl.cli.data.world import add_world, chosen_world, session_world
from rigctl.rig import open_rig

if TYPE_CHECKING:
    from rigctl.simulation.bench.world_file import SimulatedWorld


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("--rig", required=True)
    parser.add_argument("--name", default=None)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--paced", action="store_true")
    parser.add_argument("--protocol", default=None)
    parser.add_argument("--out", default=None)
    parser.add_argument("--resume", default=None)
    parser.add_argument("--order-seed", type=int, default=None)
    parser.add_argument("--yes", action="store_true")
    add_world(parser)


def run(args: argparse.Namespace) -> int:
    """Open the rig, announce the engine, wait for its first client, serve."""
    folder, name = runtime_folder(), args.name or new_engine_name()
    token = secrets.token_urlsafe(24)
    rig = open_rig(args.rig, seed=args.seed, paced=args.paced, world=_world(args))
    with closing(rig), open_listener() as listener:
        live = LiveWriter(folder / f"{name}.live")
        engine = Engine(rig, live, _utc_now, real_time=args.paced or not rig.simulated)
        port = listener.getsockname()[1]
        path = write_engine_file(
            folder, EngineFile(name, os.getpid(), port, token, args.rig, str(live.path))
        )
        try:
            # Simulated time starts later, so it does not matter when the client connects.
            address = EngineAddress(listener, token, accept_first_client(listener, token))
            _shut_down_on_signals(rig.loop, engine)
            return rig.loop.run_until_complete(
                engine.serve(address, CommandHandler(engine).handle, _run_request(args))
            )
        finally:
            live.close()
            _remove_empty(folder / f"{name}.log")
            path.unlink(missing_ok=True)


def _run_request(args: argparse.Namespace) -> RunRequest | None:
    if args.protocol is None and args.resume is None:
        return None
    return RunRequest(args.protocol, args.out, args.resume, args.order_seed, args.yes)


def _world(args: argparse.Namespace) -> SimulatedWorld | None:
    """Return the world of the named file, or that of the session to resume."""
    if args.world is None and args.resume is not None:
        return session_world(Path(args.resume))
    return chosen_world(args.world)


def _shut_down_on_signals(loop: asyncio.AbstractEventLoop, engine: Engine) -> None:
    """Shut down on SIGINT or SIGTERM as for a client: abort the run, save the session."""

    def shut_down() -> None:
        engine.shut_down("a signal ended the engine")

    for number in (signal.SIGINT, signal.SIGTERM):
        if sys.platform == "win32":
            signal.signal(number, lambda *_: loop.call_soon_threadsafe(shut_down))
        else:
            loop.add_signal_handler(number, shut_down)


def _remove_empty(log: Path) -> None:
    """Remove the log file, which the starting process created, if it is empty."""
    if sys.platform != "win32" and log.is_file() and log.stat().st_size == 0:
        log.unlink()


def _utc_now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
