"""An engine on a simulated rig inside the test's process, as fast as possible."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rigctl.acquisition import served_engine
from rigctl.acquisition.engine import Engine
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.acquisition.protocol.runner import Run
from rigctl.acquisition.rig import Rig
from rigctl.acquisition.rpc.command_handler import CommandHandler
from rigctl.acquisition.rpc.door import Door, open_listener
from rigctl.config.rig_config import RigConfig
from rigctl.rig import open_rig
from rigctl.session.read.session import Session
from rigctl.values import Event

TINY = """
name = "tiny"
textures = ["A", "L"]
speeds_mm_s = [100, 120]
forces_g = [500]
repeats = 1
"""

Scenario = Callable[["EngineHarness"], Awaitable[None]]


@dataclass
class EngineHarness:
    """One engine with its rig, its published events, and a folder to work in."""

    rig: Rig
    engine: Engine
    folder: Path
    events: list[Event] = field(default_factory=list)
    exit_code: int | None = None
    address: tuple[str, int] = ("", 0)

    @property
    def session(self) -> Path:
        """The session folder of the tests."""
        return self.folder / "session"

    def request(self, protocol: str = TINY, yes: bool = True) -> RunRequest:
        """Return a request to run this protocol."""
        path = self.folder / "protocol.toml"
        path.write_text(protocol)
        return RunRequest(protocol=str(path), out=str(self.session), yes=yes)

    def run(
        self, scenario: Scenario, request: RunRequest | None = None, engine_ends: bool = False
    ) -> None:
        """Serve until ``scenario``, which plays the operator, and the engine have ended.

        ``engine_ends``: the engine is to end first, which fails a test otherwise. It ends when
        nobody uses it, but a scenario that calls it directly does.
        """
        with pytest.MonkeyPatch.context() as patch:
            if not engine_ends:
                patch.setattr(served_engine, "IDLE_TIMEOUT_S", math.inf)
            scenario_ended = self.rig.loop.run_until_complete(self._run(scenario, request))
        assert scenario_ended is not engine_ends, f"who ended first? {self.events[-3:]}"

    def record(self, protocol: str = TINY) -> Run:
        """Run a protocol to its end and return the run."""
        self.run(until_ended, self.request(protocol))
        assert self.engine.run is not None
        return self.engine.run

    async def wait(self, seconds: float) -> None:
        """Wait in loop time."""
        end_s = self.rig.loop.time() + seconds
        while self.rig.loop.time() < end_s:
            await self.engine.boards.drum_poller.wait_cycle()

    async def until(self, condition: Callable[[], bool], limit_s: float = 120.0) -> None:
        """Wait until the condition is true; check it once per poll."""
        end_s = self.rig.loop.time() + limit_s
        while not condition():
            assert self.rig.loop.time() < end_s, "the condition never became true"
            await self.engine.boards.drum_poller.wait_cycle()

    def texts(self, kind: str) -> list[str]:
        """Return the texts of the events of this kind."""
        return [event.text for event in self.events if event.kind == kind]

    async def _run(self, scenario: Scenario, request: RunRequest | None) -> bool:
        """Return whether the scenario came to its end."""
        self.engine.event_bus.subscribe(self.events.append)
        with open_listener() as listener:
            self.address = listener.getsockname()
            serving = self.rig.loop.create_task(
                self.engine.serve(
                    Door(listener, "token"), CommandHandler(self.engine).handle, request
                )
            )
            acting = self.rig.loop.create_task(self._act(scenario, request is not None))
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

    async def _act(self, scenario: Scenario, has_request: bool) -> None:
        while not self.engine.is_ready or (has_request and self.engine.run is None):
            await asyncio.sleep(0.01)
        await scenario(self)


async def until_ended(harness: EngineHarness) -> None:
    """Wait until the run has ended."""
    await harness.until(lambda: harness.engine.run is not None and harness.engine.run.ended, 10_000)


@contextmanager
def open_harness(
    folder: Path, seed: int = 3, rig_kind: str = "virtual", config: RigConfig | None = None
) -> Iterator[EngineHarness]:
    """Open an engine on a simulated rig that does not serve yet."""
    rig = open_rig(rig_kind, seed=seed, paced=False, config=config)
    live = LiveWriter(folder / "live.ring")
    engine = Engine(rig, live, lambda: "2026-01-02T03:04:05+00:00", real_time=False)
    try:
        yield EngineHarness(rig, engine, folder)
    finally:
        live.close()
        rig.close()


def open_session(folder: Path) -> Session:
    """Open the recorded session."""
    return Session.open(folder)
