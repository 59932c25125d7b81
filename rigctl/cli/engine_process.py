"""The process around an engine: its announcement, first client, signals and end."""

from __future__ import annotations

import argparse
import asyncio
import faulthandler
import os
import secrets
import signal
import socket
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.cli.arguments import add_option, path_or_name, whole_number
from rigctl.cli.world import add_world
from rigctl.engine.keep_awake import KeepAwake, kept_awake, not_kept_awake
from rigctl.engine.rpc.commands import RequestHandler
from rigctl.engine.rpc.engine_files import (
    LIVE,
    LOG,
    SOCKET,
    EngineFile,
    new_engine_name,
    remove_files,
    rig_name,
    running_engines,
    runtime_folder,
    validate_engine_name,
    write_engine_file,
)
from rigctl.engine.rpc.server import open_listener, wait_first_client
from rigctl.engine.served_engine import ServedEngine
from rigctl.errors import WrongUse
from rigctl.experiments import DRUM_EXPERIMENT
from rigctl.protocol.plan import MAX_SEED


class EngineProcess:
    """Announces an engine to clients and serves them. ``rig``, ``world``: what the user named.

    ``is_bench``: there is one rig of this name, so it has one engine at a time, and its runs keep
    the computer awake.
    Raises WrongUse for a name that is not safe, or that a running engine has, or for a bench that
    has an engine.
    """

    def __init__(
        self,
        name: str | None,
        rig: str,
        experiment: str = DRUM_EXPERIMENT,
        is_bench: bool = False,
        world: Path | None = None,
    ) -> None:
        self._name = validate_engine_name(name) if name is not None else new_engine_name()
        self._folder = runtime_folder()
        self._rig = rig_name(rig)
        self._world = str(world.resolve()) if world is not None else ""
        self._experiment = experiment
        self._keep_awake: KeepAwake = kept_awake if is_bench else not_kept_awake
        running = running_engines(self._folder)
        if any(engine.name == self._name for engine in running):
            raise WrongUse(f"an engine named {self._name} runs already: choose another name")
        if is_bench:
            self._refuse_second(running)
        remove_files(self._folder, self._name)

    @property
    def live_path(self) -> Path:
        """Path of the engine's live data."""
        return self._folder / (self._name + LIVE)

    def serve(self, engine: ServedEngine[Any, Any], handle: RequestHandler, request: Any) -> int:
        """Announce the engine, wait for its first client, serve; return the exit code."""
        faulthandler.enable(2)  # the log then says of what native code the process died
        engine.keep_awake = self._keep_awake
        token = secrets.token_urlsafe(24)
        with open_listener(self._folder / (self._name + SOCKET)) as listener:
            try:
                write_engine_file(self._folder, self._file(listener, token))
                first = wait_first_client(listener)
                _shut_down_on_signals(engine)
                serving = engine.serve(listener, token, handle, request, first)
                return engine.loop.run_until_complete(serving)
            finally:
                _remove_empty(self._folder / (self._name + LOG))
                remove_files(self._folder, self._name)

    def _refuse_second(self, running: list[EngineFile]) -> None:
        """Raise WrongUse where an engine holds the bench already."""
        for engine in running:
            if (engine.rig, engine.experiment) == (self._rig, self._experiment):
                raise WrongUse(
                    f"an engine holds {self._rig} already (process {engine.pid}): join it with "
                    "`rigctl gui --rig join`, or disconnect its clients, then start again"
                )

    def _file(self, listener: socket.socket, token: str) -> EngineFile:
        address = listener.getsockname()
        path, port = (address, 0) if isinstance(address, str) else ("", address[1])
        live = str(self.live_path)
        rig = self._rig, live, self._experiment
        return EngineFile(self._name, os.getpid(), port, token, *rig, path, world=self._world)


def add_engine_arguments(parser: argparse.ArgumentParser, protocol: str | None) -> None:
    """Add the options of every engine's command; ``protocol``: the one without that option."""
    add_option(parser, "--rig", path_or_name, required=True)
    parser.add_argument("--name", default=None)
    add_option(parser, "--seed", whole_number(0, MAX_SEED), default=0)
    parser.add_argument("--paced", action="store_true")
    add_option(parser, "--protocol", path_or_name, default=protocol)
    add_option(parser, "--out", path_or_name, default=None)
    add_option(parser, "--resume", path_or_name, default=None)
    add_option(parser, "--order-seed", whole_number(0, MAX_SEED), default=None)
    parser.add_argument("--yes", action="store_true")
    add_world(parser)


def utc_now() -> str:
    """Return the time as ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _shut_down_on_signals(engine: ServedEngine[Any, Any]) -> None:
    """Shut down on SIGINT or SIGTERM as for a client: abort the run, save the session."""
    loop: asyncio.AbstractEventLoop = engine.loop

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
