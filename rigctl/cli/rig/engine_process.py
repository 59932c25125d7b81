"""The process around an engine: its announcement, first client, signals and end."""

from __future__ import annotations

import asyncio
import os
import secrets
import signal
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rigctl.acquisition.rpc.engine_files import (
    DRUM_EXPERIMENT,
    EngineFile,
    new_engine_name,
    runtime_folder,
    write_engine_file,
)
from rigctl.acquisition.rpc.server import (
    EngineAddress,
    RequestHandler,
    accept_first_client,
    open_listener,
)
from rigctl.acquisition.served_engine import ServedEngine


class EngineProcess:
    """Announces an engine to clients and serves them. ``rig``: what the user named."""

    def __init__(self, name: str | None, rig: str, experiment: str = DRUM_EXPERIMENT) -> None:
        self._folder, self._name = runtime_folder(), name or new_engine_name()
        self._rig = rig
        self._experiment = experiment

    @property
    def live_path(self) -> Path:
        """Path of the engine's live data."""
        return self._folder / f"{self._name}.live"

    def serve(self, engine: ServedEngine[Any, Any], handle: RequestHandler, request: Any) -> int:
        """Announce the engine, wait for its first client, serve; return the exit code."""
        token = secrets.token_urlsafe(24)
        with open_listener() as listener:
            path = write_engine_file(self._folder, self._file(listener.getsockname()[1], token))
            try:
                # Simulated time starts later, so it does not matter when the client connects.
                address = EngineAddress(listener, token, accept_first_client(listener, token))
                _shut_down_on_signals(engine)
                return engine.loop.run_until_complete(engine.serve(address, handle, request))
            finally:
                _remove_empty(self._folder / f"{self._name}.log")
                path.unlink(missing_ok=True)

    def _file(self, port: int, token: str) -> EngineFile:
        live = str(self.live_path)
        return EngineFile(self._name, os.getpid(), port, token, self._rig, live, self._experiment)


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
