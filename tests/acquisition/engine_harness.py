"""An engine on the virtual rig inside the test's process, in world time as fast as it goes."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from rigctl.acquisition.engine import Engine, EngineAddress
from rigctl.acquisition.live_buffer import LiveWriter
from rigctl.acquisition.protocol.run_request import RunRequest
from rigctl.acquisition.protocol.runner import Run
from rigctl.acquisition.rpc.command_handler import CommandHandler
from rigctl.acquisition.rpc.server import open_listener
from rigctl.config.rig_config import RigConfig
from rigctl.rig import Rig, open_rig
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
    """One engine with its rig, what it said, and folders to work in."""

    rig: Rig
    engine: Engine
    folder: Path
    said: list[Event] = field(default_factory=list)
    exit_code: int | None = None

    @property
    def session(self) -> Path:
        """Folder of the session that tests record into."""
        return self.folder / "session"

    def order(self, protocol: str = TINY, yes: bool = True) -> RunRequest:
        """An order to run this protocol's text."""
        path = self.folder / "protocol.toml"
        path.write_text(protocol)
        return RunRequest(protocol=str(path), out=str(self.session), yes=yes)

    def play(self, scenario: Scenario, order: RunRequest | None = None) -> None:
        """Serve, with ``scenario`` as the person at the rig, until both are through."""
        self.rig.loop.run_until_complete(self._play(scenario, order))

    def record(self, protocol: str = TINY) -> Run:
        """Run a protocol to its end; the run as it ended."""
        self.play(until_ended, self.order(protocol))
        assert self.engine.run is not None
        return self.engine.run

    async def passes(self, seconds: float) -> None:
        """Let world time pass."""
        end_s = self.rig.loop.time() + seconds
        while self.rig.loop.time() < end_s:
            await self.engine.boards.drum_poller.wait_turn()

    async def until(self, condition: Callable[[], bool], limit_s: float = 120.0) -> None:
        """Wait for something to become true, looking once a poll."""
        end_s = self.rig.loop.time() + limit_s
        while not condition():
            assert self.rig.loop.time() < end_s, "it never happened"
            await self.engine.boards.drum_poller.wait_turn()

    def texts(self, kind: str) -> list[str]:
        """What was said of that kind."""
        return [event.text for event in self.said if event.kind == kind]

    async def _play(self, scenario: Scenario, order: RunRequest | None) -> None:
        self.engine.event_bus.subscribe(self.said.append)
        with open_listener() as listener:
            serving = self.rig.loop.create_task(
                self.engine.serve(
                    EngineAddress(listener, "token"), CommandHandler(self.engine).handle, order
                )
            )
            acting = self.rig.loop.create_task(self._act(scenario, order is not None))
            await asyncio.wait((serving, acting), return_when=asyncio.FIRST_COMPLETED)
            if acting.done():
                self.engine.shut_down("the test is over")
            self.exit_code = await serving
            acting.cancel()
            with suppress(asyncio.CancelledError):
                await acting

    async def _act(self, scenario: Scenario, ordered: bool) -> None:
        while not self.engine.is_ready or (ordered and self.engine.run is None):
            await asyncio.sleep(0.01)
        await scenario(self)


async def until_ended(harness: EngineHarness) -> None:
    """Watch the run to its end."""
    await harness.until(lambda: harness.engine.run is not None and harness.engine.run.ended, 10_000)


@contextmanager
def open_harness(
    folder: Path, seed: int = 3, rig_kind: str = "virtual", config: RigConfig | None = None
) -> Iterator[EngineHarness]:
    """An engine on a simulated rig, not yet serving."""
    rig = open_rig(rig_kind, seed=seed, paced=False, config=config)
    live = LiveWriter(folder / "live.ring")
    engine = Engine(rig, live, lambda: "2026-01-02T03:04:05+00:00", seed, False)
    try:
        yield EngineHarness(rig, engine, folder)
    finally:
        live.close()
        rig.close()


def read(folder: Path) -> Session:
    """The recorded session."""
    return Session.open(folder)
