"""An engine of either experiment inside the test's process, as fast as possible."""

from __future__ import annotations

import asyncio
import math
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Self, TypeVar

import pytest

from rigctl.engine import served_engine
from rigctl.engine.rpc.commands import RequestHandler
from rigctl.engine.rpc.server import open_listener
from rigctl.engine.served_engine import ServedEngine
from rigctl.values import Event

_Rig = TypeVar("_Rig")
_Engine = TypeVar("_Engine", bound=ServedEngine[Any, Any])


@dataclass
class ServedHarness(ABC, Generic[_Rig, _Engine]):
    """One engine with its rig, its published events, and a folder to work in."""

    rig: _Rig
    engine: _Engine
    folder: Path
    events: list[Event] = field(default_factory=list)
    exit_code: int | None = None
    address: tuple[str, int] = ("", 0)

    @property
    @abstractmethod
    def handle(self) -> RequestHandler:
        """What executes the clients' commands."""

    @property
    def session(self) -> Path:
        """The session folder of the tests."""
        return self.folder / "session"

    def run(
        self,
        scenario: Callable[[Self], Awaitable[None]],
        request: Any = None,
        engine_ends: bool = False,
    ) -> None:
        """Serve until ``scenario``, which plays a person, and the engine have ended.

        ``engine_ends``: the engine is to end first, which fails a test otherwise. It ends when
        nobody uses it, but a scenario that calls it directly does.
        """
        with pytest.MonkeyPatch.context() as patch:
            if not engine_ends:
                patch.setattr(served_engine, "IDLE_TIMEOUT_S", math.inf)
            scenario_ended = self.engine.loop.run_until_complete(self._run(scenario, request))
        assert scenario_ended is not engine_ends, f"who ended first? {self.events[-3:]}"

    def texts(self, kind: str) -> list[str]:
        """Return the texts of the events of this kind."""
        return [event.text for event in self.events if event.kind == kind]

    def has_ended(self) -> bool:
        """Return whether the run is over and its session closed."""
        return self.engine.run is not None and self.engine.run.ended

    async def _run(self, scenario: Callable[[Self], Awaitable[None]], request: Any) -> bool:
        """Return whether the scenario came to its end."""
        self.engine.event_bus.subscribe(self.events.append)
        with open_listener() as listener:
            self.address = listener.getsockname()
            loop = self.engine.loop
            serving = loop.create_task(self.engine.serve(listener, "token", self.handle, request))
            acting = loop.create_task(self._act(scenario, request is not None))
            await asyncio.wait((serving, acting), return_when=asyncio.FIRST_COMPLETED)
            if acting.done():
                self.engine.shut_down("the test is over")
            self.exit_code = await serving
            if acting.done():
                acting.result()
                return True
            acting.cancel()
            with suppress(asyncio.CancelledError):
                await acting
            return False

    async def _act(self, scenario: Callable[[Self], Awaitable[None]], has_request: bool) -> None:
        while not self.engine.is_ready or (has_request and self.engine.run is None):
            await asyncio.sleep(0.01)
        await scenario(self)
