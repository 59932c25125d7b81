"""An engine on a simulated rig inside the test's process, as fast as possible."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rigctl.config.rig_config import RigConfig
from rigctl.engine.drum_commands import DrumCommands
from rigctl.engine.engine import Engine
from rigctl.engine.live_file import LiveWriter
from rigctl.engine.rig import Rig
from rigctl.engine.rpc.commands import RequestHandler
from rigctl.engine.run_request import RunRequest
from rigctl.engine.runner import Run
from rigctl.rig import open_rig
from rigctl.session.session import Session
from tests.engine.served_harness import ServedHarness

TINY = """
name = "tiny"
textures = ["A", "L"]
speeds_mm_s = [100, 120]
forces_g = [500]
repeats = 1
"""

Scenario = Callable[["EngineHarness"], Awaitable[None]]


@dataclass
class EngineHarness(ServedHarness[Rig, Engine]):
    """One engine with its rig, its published events, and a folder to work in."""

    @property
    def handle(self) -> RequestHandler:
        """What executes the clients' commands."""
        return DrumCommands(self.engine).handle

    def request(self, protocol: str = TINY, yes: bool = True) -> RunRequest:
        """Return a request to run this protocol."""
        path = self.folder / "protocol.toml"
        path.write_text(protocol)
        return RunRequest(protocol=str(path), out=str(self.session), yes=yes)

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


async def until_ended(harness: EngineHarness) -> None:
    """Wait until the run has ended."""
    await harness.until(harness.has_ended, 10_000)


@contextmanager
def open_harness(
    folder: Path, seed: int = 3, rig_kind: str = "virtual", config: RigConfig | None = None
) -> Iterator[EngineHarness]:
    """Open an engine on a simulated rig that does not serve yet."""
    with engine_on(open_rig(rig_kind, seed=seed, paced=False, config=config), folder) as harness:
        yield harness


@contextmanager
def engine_on(rig: Rig, folder: Path) -> Iterator[EngineHarness]:
    """Open an engine on a rig, and close both."""
    live = LiveWriter(folder / "live.ring", rig.config.taxels.count)
    engine = Engine(rig, live, lambda: "2026-01-02T03:04:05+00:00", real_time=False)
    try:
        yield EngineHarness(rig, engine, folder)
    finally:
        live.close()
        rig.close()


def open_session(folder: Path) -> Session:
    """Open the recorded session."""
    return Session.open(folder)
