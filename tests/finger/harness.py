"""An engine of the virtual finger inside the test's process, as fast as possible."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rigctl.engine.rpc.commands import RequestHandler
from rigctl.finger.commands import FingerCommands
from rigctl.finger.config import FingerConfig
from rigctl.finger.engine import FingerEngine
from rigctl.finger.live_file import FingerLiveWriter
from rigctl.finger.open_rig import open_finger_rig
from rigctl.finger.rig import FingerRig
from rigctl.finger.run import FingerRun
from rigctl.finger.run_request import FingerRunRequest
from rigctl.finger.session import FingerSession
from tests.engine.served_harness import ServedHarness

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
class FingerHarness(ServedHarness[FingerRig, FingerEngine]):
    """One engine with its rig, its published events, and a folder to work in."""

    @property
    def handle(self) -> RequestHandler:
        """What executes the clients' commands."""
        return FingerCommands(self.engine).handle

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


async def until_ended(harness: FingerHarness) -> None:
    """Wait until the run has ended."""
    await harness.until(harness.has_ended, 10_000)


@contextmanager
def open_finger_harness(
    folder: Path,
    seed: int = 3,
    session: int = 0,
    kind: str = "virtual",
    config: FingerConfig | None = None,
) -> Iterator[FingerHarness]:
    """Open an engine on a virtual finger that does not serve yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = open_finger_rig(kind, seed=seed, session=session, paced=False)
    rig.config = config or rig.config
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
