"""An engine of the virtual finger inside the test's process, as fast as possible."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rigctl.acquisition import served_engine
from rigctl.acquisition.rpc.door import Door, open_listener
from rigctl.finger_rig import open_finger_rig
from rigctl.realtime.finger_commands import FingerCommands
from rigctl.realtime.finger_engine import FingerEngine
from rigctl.realtime.finger_rig import FingerRig
from rigctl.realtime.live_file import FingerLiveWriter
from rigctl.realtime.run.finger_run import FingerRun
from rigctl.realtime.run.finger_run_request import FingerRunRequest
from rigctl.session.read.finger_session import FingerSession
from rigctl.values import Event

SMALL = """
name = "small"
textures = ["A", "D", "L"]
profiles = ["medium", "fast"]

[stages]
normalise = 1
train = 3
calibrate = 2
run = 1
"""
ONE_SCAN = """
name = "one-scan"
textures = ["D", "L"]
profiles = ["medium"]

[stages]
normalise = 1
train = 0
calibrate = 0
run = 0
"""
Scenario = Callable[["FingerHarness"], Awaitable[None]]


@dataclass
class FingerHarness:
    """One engine with its rig, its published events, and a folder to work in."""

    rig: FingerRig
    engine: FingerEngine
    folder: Path
    events: list[Event] = field(default_factory=list)
    exit_code: int | None = None
    address: tuple[str, int] = ("", 0)

    @property
    def session(self) -> Path:
        """The session folder of the tests."""
        return self.folder / "session"

    def request(
        self,
        *stages: str,
        protocol: str = SMALL,
        model: Path | None = None,
        yes: bool = True,
    ) -> FingerRunRequest:
        """Return a request to record stages of a protocol."""
        path = self.folder / "protocol.toml"
        path.write_text(protocol)
        return FingerRunRequest(
            stages=stages or ("normalise",),
            protocol=str(path),
            model=str(model) if model else None,
            out=str(self.session),
            yes=yes,
        )

    def run(
        self, scenario: Scenario, request: FingerRunRequest | None = None, engine_ends: bool = False
    ) -> None:
        """Serve until ``scenario``, which plays a person, and the engine have ended.

        ``engine_ends``: the engine is to end first, which fails a test otherwise. It ends when
        nobody uses it, but a scenario that calls it directly does.
        """
        with pytest.MonkeyPatch.context() as patch:
            if not engine_ends:
                patch.setattr(served_engine, "IDLE_TIMEOUT_S", math.inf)
            scenario_ended = self.rig.loop.run_until_complete(self._run(scenario, request))
        assert scenario_ended is not engine_ends, f"who ended first? {self.events[-3:]}"

    def record(self, request: FingerRunRequest) -> FingerRun:
        """Record to the end and return the run."""
        self.run(until_ended, request)
        assert self.engine.run is not None
        return self.engine.run

    async def until(self, condition: Callable[[], bool], limit_s: float = 60.0) -> None:
        """Wait until the condition is true."""
        end_s = self.rig.loop.time() + limit_s
        while not condition():
            assert self.rig.loop.time() < end_s, "the condition never became true"
            await asyncio.sleep(0.005)

    async def until_scanning(self, at_mm: float = 0.0) -> None:
        """Wait until the finger is between the marks, and as far as this."""

        def there() -> bool:
            status = self.engine.status()
            scan = status.run.scan
            return scan is not None and scan.scanning and status.along_mm >= at_mm

        await self.until(there)

    def texts(self, kind: str) -> list[str]:
        """Return the texts of the events of this kind."""
        return [event.text for event in self.events if event.kind == kind]

    async def _run(self, scenario: Scenario, request: FingerRunRequest | None) -> bool:
        """Return whether the scenario came to its end."""
        self.engine.event_bus.subscribe(self.events.append)
        handle = FingerCommands(self.engine).handle
        with open_listener() as listener:
            self.address = listener.getsockname()
            address = Door(listener, "token")
            serving = self.rig.loop.create_task(self.engine.serve(address, handle, request))
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


async def until_ended(harness: FingerHarness) -> None:
    """Wait until the run has ended."""
    await harness.until(lambda: harness.engine.run is not None and harness.engine.run.ended, 10_000)


@contextmanager
def open_finger_harness(
    folder: Path, seed: int = 3, session: int = 0, kind: str = "virtual"
) -> Iterator[FingerHarness]:
    """Open an engine on a virtual finger that does not serve yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = open_finger_rig(kind, seed=seed, session=session, paced=False)
    live = FingerLiveWriter(folder / "live.ring")
    engine = FingerEngine(rig, live, lambda: "2026-01-02T03:04:05+00:00")
    try:
        yield FingerHarness(rig, engine, folder)
    finally:
        live.close()
        rig.close()


def open_finger_session(folder: Path) -> FingerSession:
    """Open the recorded session."""
    return FingerSession.open(folder)
