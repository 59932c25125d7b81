"""One measurement of a calibration at a time, which can be cancelled and ends with a safe drum."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from rigctl.acquisition.calibration.calibrator import Calibrator
from rigctl.errors import CommandRefused, WrongUse

BUSY = "a calibration measures now: wait for its end, or cancel it"
CANCELLED = "the calibration was cancelled"
_Result = TypeVar("_Result")


class Measurement:
    """Runs one measurement at a time; meanwhile no run begins.

    ``part``: the part of the calibration that is measured, empty while nothing is. ``usual_s``: how
    long that takes, 0 for what nobody waits for.
    """

    def __init__(self, calibrator: Calibrator, loop: asyncio.AbstractEventLoop) -> None:
        self._calibrator, self._loop = calibrator, loop
        self.part, self.usual_s = "", 0.0
        self._begun_s = 0.0
        self._task: asyncio.Task[object] | None = None
        self._is_cancelled = False
        self._ended = asyncio.Event()

    @property
    def elapsed_s(self) -> float:
        """Time since the measurement began, 0 without one."""
        return self._loop.time() - self._begun_s if self.part else 0.0

    def require_none(self) -> None:
        """Raise WrongUse while something is measured."""
        if self.part:
            raise WrongUse(BUSY)

    def require_ready(self) -> None:
        """Raise WrongUse while something is measured, CommandRefused while the drum presses."""
        self.require_none()
        self._calibrator.require_no_contact()

    async def run(
        self, part: str, work: Coroutine[Any, Any, _Result], usual_s: float = 0.0
    ) -> _Result:
        """Return the result of the work; then the drum is lifted and switched off.

        Raises what the work raises, CommandRefused where it was cancelled or a STOP came.
        """
        self.part, self.usual_s = part, usual_s
        self._begun_s, self._is_cancelled = self._loop.time(), False
        self._ended.clear()
        try:
            with self._calibrator.motion.by_hand():
                try:
                    return await self._finish(work)
                finally:
                    await self._calibrator.switch_off()
        finally:
            self.part, self.usual_s = "", 0.0
            self._ended.set()

    def cancel(self) -> None:
        """End the measurement, if there is one, and switch the drum off."""
        if self._task is not None:
            self._is_cancelled = True
            self._task.cancel()

    async def end(self) -> None:
        """Cancel the measurement, if there is one, and wait until the drum is switched off."""
        self.cancel()
        if self.part:
            await self._ended.wait()

    async def _finish(self, work: Coroutine[Any, Any, _Result]) -> _Result:
        task = self._loop.create_task(work)
        self._task = task
        try:
            return await task
        except asyncio.CancelledError:
            if self._is_cancelled:
                raise CommandRefused(CANCELLED) from None
            raise
        finally:
            self._task = None
