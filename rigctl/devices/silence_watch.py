"""Notices that a stream has fallen silent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

WATCHDOG_INTERVAL_S = 0.05


class SilenceWatch:
    """Calls ``on_silence`` where nothing is heard for ``timeout_s``; it checks every 50 ms.

    ``heard_s``: loop time at which something was heard last, 0 before.
    """

    def __init__(
        self, loop: asyncio.AbstractEventLoop, timeout_s: float, on_silence: Callable[[], None]
    ) -> None:
        self.heard_s = 0.0
        self._loop = loop
        self._timeout_s = timeout_s
        self._on_silence = on_silence
        self._timer: asyncio.TimerHandle | None = None

    @property
    def running(self) -> bool:
        """True between start and stop."""
        return self._timer is not None

    def start(self) -> None:
        """Start to watch: silence counts from now."""
        self.stop()
        self.heard_s = self._loop.time()
        self._schedule(self.heard_s + WATCHDOG_INTERVAL_S)

    def stop(self) -> None:
        """Stop to watch; stopping twice is harmless."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _schedule(self, at_s: float) -> None:
        self._timer = self._loop.call_at(at_s, self._check, at_s)

    def _check(self, due_s: float) -> None:
        """Report silence, unless the loop itself is late and has bytes to read first."""
        now_s = self._loop.time()
        self._schedule(now_s + WATCHDOG_INTERVAL_S)
        if now_s - self.heard_s > self._timeout_s and now_s - due_s < WATCHDOG_INTERVAL_S:
            self._on_silence()
