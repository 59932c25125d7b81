"""Turn Ctrl-C into a request to end at the next safe place."""

from __future__ import annotations

import signal
from types import FrameType
from typing import Any


class Interrupt:
    """Notes the first SIGINT or SIGTERM while entered; a second one acts as usual."""

    def __init__(self) -> None:
        self._before: dict[int, Any] = {}
        self._requested = False

    def requested(self) -> bool:
        """Return whether a signal has asked the work to end."""
        return self._requested

    def __enter__(self) -> Interrupt:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._before[number] = signal.signal(number, self._caught)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _caught(self, number: int, frame: FrameType | None) -> None:
        self._requested = True
        signal.signal(number, self._before[number])
