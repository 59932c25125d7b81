"""The commands of clients of the finger's engine."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from rigctl.engine.engine_commands import EngineCommands
from rigctl.engine.rpc.commands import Number
from rigctl.finger.engine import FingerEngine
from rigctl.finger.run_request import FingerRunRequest

LoopTime = Annotated[float, Meta(ge=0, le=1e9)]


class FingerCommands(EngineCommands[FingerEngine]):
    """Executes requests to the engine of the moving finger."""

    request_type = FingerRunRequest

    def __init__(self, engine: FingerEngine) -> None:
        super().__init__(engine, lambda: engine.rig.faults)

    async def on_stop(self, by: str) -> None:
        """End the run; the finger board itself moves nothing."""
        if self._engine.is_running:
            self._control().abort(f"stopped by {by}")

    async def on_shown(self, scan: Number, sent_s: LoopTime) -> None:
        """Record that a client has painted the answer that a velocity led to."""
        run = self._engine.run
        if run is not None and run.has_scanned(scan):
            run.output.add_screen(scan, self._engine.rig.loop.time(), sent_s)
