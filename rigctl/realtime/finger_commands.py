"""The commands of clients of the finger's engine."""

from __future__ import annotations

from rigctl.acquisition.rpc.engine_commands import EngineCommands, validate_number
from rigctl.realtime.finger_engine import FingerEngine
from rigctl.realtime.run.finger_run_request import FingerRunRequest


class FingerCommands(EngineCommands[FingerEngine]):
    """Executes requests to the engine of the moving finger."""

    def __init__(self, engine: FingerEngine) -> None:
        super().__init__(engine, FingerRunRequest, lambda: engine.rig.faults)

    async def on_stop(self) -> None:
        """End the run; the finger board itself moves nothing."""
        if self._engine.is_running:
            self._control().abort("stopped by a client")

    async def on_shown(self, scan: int, sent_s: float) -> None:
        """Record that a client has painted the answer that a velocity led to."""
        number, sent_s = int(validate_number("scan", scan)), validate_number("sent_s", sent_s)
        run = self._engine.run
        if run is not None and run.has_scanned(number):
            run.output.add_screen(number, self._engine.rig.loop.time(), sent_s)
