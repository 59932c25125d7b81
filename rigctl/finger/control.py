"""How every wait of a run of the moving finger notices pauses, questions and the end."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rigctl.engine.run_reasons import RunReasons

CHECK_PERIOD_S = 0.01


class FingerControl(RunReasons):
    """Reasons to pause or to end a run, checked a hundred times a second of loop time."""

    def check(self) -> None:
        """Raise RunStopped, RigFault or RunPaused where there is a reason."""
        self.check_end()
        self.check_pause()

    async def wait_until(self, is_done: Callable[[], bool]) -> None:
        """Wait for a condition."""
        while not is_done():
            await asyncio.sleep(CHECK_PERIOD_S)
            self.check()

    async def _wait_paused(self) -> None:
        await asyncio.sleep(CHECK_PERIOD_S)
        self.check_end()
